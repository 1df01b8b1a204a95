"""The hypotheses that add no term: sensor faults, and another initial state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from dashred.core.budget import Budget
from dashred.inference.fit.law import Law
from dashred.inference.hypotheses.comparison.faults_beside_laws import (
    search_faults_beside_best,
)
from dashred.inference.hypotheses.hypothesis_fit import (
    REJECTION_MARGIN,
    HypothesisFit,
    by_score,
)
from dashred.inference.hypotheses.result import AMBIGUITY_MARGIN
from dashred.inference.hypotheses.sensors.fault_fits import fit_sensor_hypotheses
from dashred.inference.hypotheses.sensors.start_hypotheses import fit_start_hypotheses


def fit_fault_hypotheses(
    best: HypothesisFit, null: HypothesisFit, budget: Budget
) -> list[HypothesisFit]:
    """Return the laws, and the hypotheses that add sensor faults to them.

    Args:
        best: the best law that acts everywhere.
        null: the uncorrected simulator.
        budget: gets the faults beside the law if there was no time for them.

    Raises:
        OutOfTimeError: there was no time for the faults without a law.
    """
    faults = fit_sensor_hypotheses(null, best.law.score + AMBIGUITY_MARGIN)
    if not best.law.candidates:
        return [null, *faults]
    beside: list[HypothesisFit] = budget.attempt(
        "sensor faults beside the law", lambda: search_faults_beside_best([best], set()), []
    )
    return [best, null, *faults, *beside]


def fit_other_starts(
    best: HypothesisFit, null: HypothesisFit, budget: Budget
) -> list[HypothesisFit]:
    """Return the hypothesis of another initial state, or none.

    Args:
        best: the best law that acts everywhere.
        null: the uncorrected simulator; there is none if its prior is already widened.
        budget: gets the hypothesis if there was no time for it.
    """
    if null.law.start_prior_factor > 1:
        return []
    bound = best.law.score + REJECTION_MARGIN
    return budget.attempt("another initial state", lambda: fit_start_hypotheses(null, bound), [])


def is_of_other_shape(start: HypothesisFit, others: Sequence[HypothesisFit]) -> bool:
    """Return whether a wider prior of the start is needed although its spread is not exceeded.

    The correlation length of the prior is a guess, so the start may have another one. It must be
    clearly better than the other hypotheses.

    Args:
        start: the hypothesis of a wider prior.
        others: the other hypotheses.
    """
    margin = min(map(by_score, others)) - start.law.score
    return not start.law.parts and margin > AMBIGUITY_MARGIN


def under_same_prior(law: Law, other: Law) -> Law:
    """Return a law that was fitted under the prior of the start of another."""
    return replace(
        law, start_prior_factor=other.start_prior_factor, start_chance=other.start_chance
    )


def without_penalty(fit: HypothesisFit) -> HypothesisFit:
    """Return a hypothesis without terms with F as its score, as a base for other hypotheses."""
    [cost], _ = fit.objective.values(fit.phi[None])
    return replace(fit, law=replace(fit.law, score=float(cost)))
