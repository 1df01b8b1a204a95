"""Drop terms that a law does not need.

A term may have explained what a faulty sensor reads; then the faults explain the recording alone.
"""

from __future__ import annotations

from dataclasses import replace

from dashred.inference.fit.least_squares import LeastSquaresProblem, NormalEquations
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit, replace_minimum

STEPS, TOLERANCE = 10, 1e-4


def drop_needless_terms(fit: HypothesisFit, penalty: float) -> list[HypothesisFit]:
    """Return a law with fewer terms and the same faults, after every term that is dropped.

    A law in a window, of a source or of the extended library stays as it is, as does one that was
    fitted without some sensors.

    Args:
        fit: a law, with its sensor faults.
        penalty: penalty of one term in the score.
    """
    found: list[HypothesisFit] = []
    law = fit.law
    if law.window is not None or law.source is not None or law.is_extended or fit.excluded:
        return found
    while fit.law.candidates:
        losses = [_loss_without(fit, term) for term in range(len(fit.law.candidates))]
        least = min(losses)
        if least > penalty:
            break
        smaller = _without(fit, losses.index(least))
        fewer = replace(smaller.law, score=smaller.law.score - penalty)
        if fewer.score > fit.law.score:
            break
        fit = replace(smaller, law=fewer)
        found.append(fit)
    return found


def _loss_without(fit: HypothesisFit, term: int) -> float:
    """Return the increase of the linearised F without a term."""
    normal, dropped = fit.normal, fit.objective.modes + term
    others = [j for j in range(len(normal.phi)) if j != dropped]
    smaller = NormalEquations(
        normal.jacobian[:, others],
        normal.precision[others],
        normal.phi[others],
        # The target of the other unknowns stays the same.
        normal.residuals - normal.jacobian[:, dropped] * normal.phi[dropped],
    )
    return smaller.minimum() - normal.minimum()


def _without(fit: HypothesisFit, term: int) -> HypothesisFit:
    objective = fit.objective
    law = objective.forward_model.law
    members = [j for j in range(law.count) if j != term]
    others = [j for j in range(len(objective.prior_std)) if j != term]
    forward_model = replace(
        objective.forward_model, law=LawBlock([law.candidates[j] for j in members])
    )
    smaller: LeastSquaresProblem = replace(
        objective, forward_model=forward_model, prior_std=objective.prior_std[others]
    )
    phi = fit.phi[[j for j in range(len(fit.phi)) if j != objective.modes + term]]
    return replace_minimum(fit, smaller, minimise(smaller, phi, STEPS, TOLERANCE))
