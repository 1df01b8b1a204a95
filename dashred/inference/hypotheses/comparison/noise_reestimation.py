"""Estimates of the noise from the residuals of a free forcing or of the best hypothesis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.hypotheses.free_forcing import FreeForcing
from dashred.inference.hypotheses.hypothesis_fit import (
    REJECTION_MARGIN,
    HypothesisFit,
    by_score,
    refine,
    refit,
)
from dashred.inference.hypotheses.sensors.excluded_sensors import add_faults


def estimate_noise_under_forcing(forcing: FreeForcing) -> NoiseModel:
    """Estimate the noise from the residuals of a free forcing, which no wrong law affects."""
    objective, phi = forcing.objective, forcing.phi
    [readings] = objective.forward_model.readings(*objective.split(phi[None]))
    spent = forcing.normal.effective_parameters(range(len(phi)))
    return objective.estimate_noise(readings, spent).over(objective.noise)


def noise_left_by(fit: HypothesisFit) -> NoiseModel:
    """Estimate the noise from the residuals of a hypothesis."""
    [readings] = fit.objective.forward_model.readings(*fit.objective.split(fit.phi[None]))
    spent = fit.normal.effective_parameters(range(len(fit.phi)))
    return fit.objective.estimate_noise(readings, spent)


def refit_under_best_noise(fits: Sequence[HypothesisFit]) -> list[HypothesisFit]:
    """Refit all plausible hypotheses under the noise that the best one leaves.

    A free forcing is coarse in space and time. Its residuals are larger than the noise, and such
    noise would hide lower minima of the best hypothesis.
    """
    best = min(fits, key=by_score)
    noise = noise_left_by(best)
    bound = best.law.score + REJECTION_MARGIN
    plausible = [fit for fit in fits if fit.law.score < bound or not fit.law.parts]
    refits = [refit_under_noise(fit, noise) for fit in plausible]
    best = min(refits, key=by_score)
    needs_refinement = best.law.candidates and not best.law.faults
    return [refine(fit) if fit is best and needs_refinement else fit for fit in refits]


def refit_under_noise(fit: HypothesisFit, noise: NoiseModel) -> HypothesisFit:
    """Refit a hypothesis to the same samples under another noise."""
    if fit.excluded is not None:
        without_faults = refit_under_noise(fit.excluded.without_faults, noise)
        return add_faults(without_faults, fit.excluded.sensors)
    problem = fit.objective
    return refit(fit, replace(problem, noise=noise.over(problem.noise)))
