"""The hypotheses that add no term: sensor faults, and another initial state."""

from __future__ import annotations

from collections.abc import Callable

from dashred.core.budget import Budget
from dashred.inference.hypotheses.comparison.faults_beside_laws import (
    search_faults_beside_best,
)
from dashred.inference.hypotheses.hypothesis_fit import REJECTION_MARGIN, HypothesisFit
from dashred.inference.hypotheses.result import AMBIGUITY_MARGIN
from dashred.inference.hypotheses.sensors.fault_fits import fit_sensor_hypotheses
from dashred.inference.hypotheses.sensors.start_hypotheses import fit_start_hypotheses


def fit_global_hypotheses(
    best: HypothesisFit, null: HypothesisFit, budget: Budget
) -> list[HypothesisFit]:
    """Return the laws, and the hypotheses that add a sensor fault or an initial state.

    Args:
        best: the best law that acts everywhere.
        null: the uncorrected simulator.
        budget: gets the hypotheses for which there was no time.
    """
    score = best.law.score
    families: list[tuple[str, Callable[[], list[HypothesisFit]]]] = [
        ("sensor faults", lambda: fit_sensor_hypotheses(null, score + AMBIGUITY_MARGIN)),
        ("another initial state", lambda: fit_start_hypotheses(null, score + REJECTION_MARGIN)),
    ]
    fits = [null]
    if best.law.candidates:
        fits.insert(0, best)
        beside = ("sensor faults beside the law", lambda: search_faults_beside_best([best], set()))
        families.insert(1, beside)
    for name, fit_family in families:
        fits += budget.attempt(name, fit_family, [])
    return fits
