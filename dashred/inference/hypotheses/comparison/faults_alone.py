"""Sensor faults that explain a recording alone, so that no other cause is fitted."""

from __future__ import annotations

import math

from torch import Tensor

from dashred.core.budget import Budget
from dashred.inference.fit.law import distinct_laws
from dashred.inference.hypotheses.comparison.comparison import Comparison
from dashred.inference.hypotheses.comparison.faults_beside_laws import (
    forcing_gain_beside,
    has_neighbouring_faults,
    is_curves_alone,
)
from dashred.inference.hypotheses.comparison.global_hypotheses import fit_fault_hypotheses
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit, by_score
from dashred.inference.hypotheses.result import MAX_EXPLAINED_CHI2, MIN_FORCING_GAIN


def compare_faults_alone(
    null: HypothesisFit, tendency_rms: Tensor, budget: Budget
) -> Comparison | None:
    """Compare the uncorrected simulator with sensor faults alone.

    None if they leave more than noise, if the other sensors show a forcing, or if the faults may
    imitate a law: wandering sensors, and neighbours that err.

    Args:
        null: the uncorrected simulator, from a start that the faulty sensors have not dragged.
        tendency_rms: rms of each equation's own tendency, ``(equation,)``.
        budget: gets what there was no time for.

    Raises:
        OutOfTimeError: there was no time for the faults.
    """
    fits = fit_fault_hypotheses(null, null, budget)
    best = min(fits, key=by_score)
    if not best.law.faults or is_curves_alone(best.law) or has_neighbouring_faults(best):
        return None
    if best.law.chi2 >= MAX_EXPLAINED_CHI2:
        return None
    gain = budget.attempt(
        "a forcing beside the faulty sensors",
        lambda: forcing_gain_beside(best, tendency_rms),
        math.inf,
    )
    if gain > MIN_FORCING_GAIN:
        return None
    noise = null.objective.noise
    laws = distinct_laws([fit.law for fit in fits])
    return Comparison(laws, null.law, noise, noise, gain, None)
