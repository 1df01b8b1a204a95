"""Sensor faults beside the best law, and what else could explain them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from torch import Tensor

from dashred.inference.fit.law import Law
from dashred.inference.hypotheses.comparison.noise_reestimation import (
    refit_under_noise,
)
from dashred.inference.hypotheses.comparison.residual_forcing import (
    ResidualForcing,
)
from dashred.inference.hypotheses.free_forcing import fit_free_forcing
from dashred.inference.hypotheses.hypothesis_fit import (
    HypothesisFit,
    by_score,
    refit,
)
from dashred.inference.hypotheses.result import AMBIGUITY_MARGIN
from dashred.inference.hypotheses.sensors.fault_fits import fit_sensor_hypotheses


def search_faults_again(fits: Sequence[HypothesisFit]) -> list[HypothesisFit]:
    """Return further sensor hypotheses, if the best one has sensor faults.

    Its noise is smaller than that of the first search, so faults of other sensors may show.
    """
    best = min(fits, key=by_score)
    if not best.faults:
        return []
    bases = [fit for fit in fits if fit.law.keys == best.law.keys and not fit.law.faults]
    return [
        found
        for base in bases[:1]
        for found in fit_sensor_hypotheses(base, best.law.score)
        if found.law.score < best.law.score
    ]


def is_curves_alone(law: Law) -> bool:
    """Tell whether wandering sensors alone explain the recording."""
    return not law.candidates and any(fault.kind == "wandering" for fault in law.faults)


def forcing_gain_over(faults: HypothesisFit, null: HypothesisFit, tendency_rms: Tensor) -> float:
    """Return the evidence that a free forcing gains over sensor faults, under the same noise.

    Error curves of several sensors can imitate a source near them, and a forcing then explains all
    of them at once.
    """
    _, gain = fit_free_forcing(null.objective, null.phi, tendency_rms)
    return faults.law.score - (null.law.score - gain)


def refit_rivals_beside_faults(
    residual: ResidualForcing, fits: Sequence[HypothesisFit], rivals: Sequence[HypothesisFit]
) -> list[HypothesisFit]:
    """Return the rivals of the best law with and without a sensor fault, if it won with one.

    Without the fault their scores could not be compared with that of the best law.
    """
    best_fit, noise = min(fits, key=by_score), residual.full_problem.noise
    if not best_fit.law.faults or best_fit.law.keys != residual.best.law.keys:
        return []
    if residual.faulty:
        refits = [refit(rival, replace(rival.objective, noise=noise)) for rival in rivals]
        return residual.add_faults(refits)
    bound = best_fit.law.score + AMBIGUITY_MARGIN
    refits = [refit_under_noise(rival, noise) for rival in rivals]
    with_faults = [fit for rival in refits for fit in fit_sensor_hypotheses(rival, bound)]
    return [*refits, *with_faults]
