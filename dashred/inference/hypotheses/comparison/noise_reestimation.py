"""The noise under which explanations are compared: what a forcing, or the best of them, leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.hypotheses.free_forcing import FreeForcing
from dashred.inference.hypotheses.hypothesis_fit import (
    HOPELESS,
    HypothesisFit,
    by_score,
    refitted,
    settled,
)
from dashred.inference.hypotheses.sensors.leave_one_sensor_out import beside_the_fault


def noise_left_by(forced: FreeForcing) -> NoiseModel:
    """Return the noise that is left under a free forcing: no wrong law has a part in it."""
    objective, phi = forced.objective, forced.phi
    [readings] = objective.forward_model.readings(*objective.split(phi[None]))
    spent = forced.normal.effective_parameters(range(len(phi)))
    return replace(objective.estimate_noise(readings, spent), available=objective.noise.available)


def refitted_under_own_noise(found: Sequence[HypothesisFit]) -> list[HypothesisFit]:
    """Fit all that may still be right again, under the noise that the best of them leaves.

    Between its cells and knots a free forcing is not that of the truth: what it leaves is larger
    than noise, and hides lower minima of the best.
    """
    best = min(found, key=by_score)
    [readings] = best.objective.forward_model.readings(*best.objective.split(best.phi[None]))
    noise = best.objective.estimate_noise(
        readings, best.normal.effective_parameters(range(len(best.phi)))
    )
    bound = best.law.score + HOPELESS
    kept = [cause for cause in found if cause.law.score < bound or not cause.law.parts]
    again = [refitted_under(cause, noise) for cause in kept]
    best = min(again, key=by_score)
    lawful = best.law.candidates and best.law.fault is None
    return [settled(cause) if cause is best and lawful else cause for cause in again]


def refitted_under(cause: HypothesisFit, noise: NoiseModel) -> HypothesisFit:
    """Return an explanation fitted under another noise; the samples that it sees stay its own."""
    if cause.left_out is not None:
        bare = refitted_under(cause.left_out.bare, noise)
        return beside_the_fault(bare, cause.left_out.sensor)
    before = cause.objective
    return refitted(cause, replace(before, noise=replace(noise, available=before.noise.available)))
