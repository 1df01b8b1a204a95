"""Fit one trajectory over the whole record, from the law and the states found over segments.

This is the limit q → 0 of the model error. It replaces the growing horizon where it succeeds.
"""

from __future__ import annotations

from dataclasses import replace

import torch

from dashred.inference.fit.growing_horizon import HorizonFit
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise, minimise_growing_horizon
from dashred.inference.forward.candidates import indices_by_name
from dashred.inference.initial_state.start_models import project_state
from dashred.inference.segments.selection.search import SegmentSearch
from dashred.pipeline.discovery.first_guess_stage import FittedGuess

STEPS, TOLERANCE = 20, 1e-4
# The trajectory has to fit the readings about as well as the segments do.
MAX_RATIO = 1.3
# First samples of a fit over a growing horizon.
FIRST_SAMPLES = 6


def follow_segments(
    objective: LeastSquaresProblem, segments: SegmentSearch, tight: float
) -> tuple[FittedGuess, HorizonFit] | None:
    """Return the start and the fit of one trajectory; None if it does not follow the record.

    The prior is widened for a law with larger coefficients. The natural scales come from the
    simulation, which may be far from the record where the law is large.

    Args:
        objective: F of all candidates over the whole record.
        segments: laws found over segments.
        tight: prior std of the coefficients while a horizon grows, in their natural scales.
    """
    best = segments.best
    candidates, xi = segments.terms(best)
    index = indices_by_name(objective.forward_model.law.candidates)
    members = [index[str(candidate)] for candidate in candidates]
    order = sorted(range(len(members)), key=members.__getitem__)
    chosen = tuple(members[j] for j in order)
    begins = best.fit.point.nodes[segments.problem.segments.begins]
    model, changes = objective.forward_model, torch.from_numpy(best.fit.point.parameters)
    z = project_state(model.start, torch.from_numpy(begins))
    phi = torch.cat([z, model.scaled_changes(changes), torch.from_numpy(xi)[order]])
    law = objective.subset(chosen)
    values = phi[objective.modes :].abs()
    law = replace(law, prior_std=torch.maximum(law.prior_std, values))
    ratios = values / (tight * law.forward_model.law.scales)
    widest = max([1.0, *ratios.tolist()])
    fitted = minimise(law, phi, STEPS, TOLERANCE)
    limit = MAX_RATIO * max(1.0, segments.level) * objective.noise.count
    if not fitted.chi2 < limit:
        grown = minimise_growing_horizon(law, phi, FIRST_SAMPLES)
        fitted = minimise(law, grown, STEPS, TOLERANCE)
    # Written with "not", because the misfit is NaN after a blow-up.
    if not fitted.chi2 < limit:
        return None
    samples, level = len(objective.recorded), fitted.chi2 / max(1, objective.noise.count)
    whole = objective.embed(fitted.phi, chosen)
    levels = [(samples, level)]
    horizon = HorizonFit(
        whole, chosen, fitted.readings, samples, True, levels, widened=chosen, widest=widest
    )
    guess = FittedGuess("segments", model.start, fitted.phi[: objective.modes], level**0.5)
    return guess, horizon
