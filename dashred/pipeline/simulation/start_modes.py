"""How many modes of a random start the fits need."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.physics.runs.initial_state_prior import (
    OMITTED,
    StartPrior,
    field_rms,
    fitted_modes,
)
from dashred.physics.solvers.simulate import simulate
from dashred.pipeline.problem import Problem
from dashred.pipeline.time_shares import takes_too_long

# Shares of the variance that may be omitted, until the readings do not show it.
SHARES = (OMITTED, OMITTED / 10, OMITTED / 100)
# Random starts that are compared.
STARTS = 4
# Part of the fit in which they are compared: later on, in chaos, every difference grows.
COMPARED, MIN_SAMPLES = 0.1, 4
# Largest sum of the squared changes of the readings of the fit in units of σ: a law would explain
# a larger one, although it is due to the start.
LARGEST = 1.0


@torch.no_grad()
def start_prior(problem: Problem, centre: Tensor, states: Tensor) -> StartPrior:
    """Return the prior of the start with as many modes as the readings show.

    Modes are added until those that are left out change the readings of the fit by less than their
    noise, ``E Σ ((H x − H x')/σ)² ≤ 1``. A mode that is damped at once is not needed, and one that
    stays is, even with a small share of the variance.

    Args:
        problem: the simulator and the recording.
        centre: expected start, ``(field, *grid)``.
        states: the nominal simulation, ``(time, field, *grid)``, to which a spread in percent
            refers.
    """
    system, rms = problem.system, field_rms(states)
    first = StartPrior(system, centre, rms, fitted_modes(system))
    is_stated = "modes" in system.config.spread
    if not system.axes or is_stated or not first.size or _is_expensive(problem):
        return first
    whole = StartPrior(system, centre, rms, fitted_modes(system, SHARES[-1] / 10))
    z = torch.from_numpy(problem.rng("modes of the start").standard_normal((STARTS, whole.size)))
    runs = _readings(problem, whole.start(z))
    for share in SHARES:
        prior = StartPrior(system, centre, rms, fitted_modes(system, share))
        kept = z.reshape(STARTS, -1, len(whole.basis))[..., : len(prior.basis)]
        change = runs - _readings(problem, prior.start(kept.flatten(1)))
        if float(change.square().flatten(1).nansum(dim=1).mean()) <= LARGEST:
            break
    return prior


def _is_expensive(problem: Problem) -> bool:
    return problem.snapshots is not None or takes_too_long(
        problem.system, problem.times, problem.budget
    )


def _readings(problem: Problem, starts: Tensor) -> Tensor:
    """Return readings in units of σ, ``(start, time, sensor)``.

    They are of the first samples, and are weighted so that their sum of squares is that of all
    readings of the fit. Missing readings do not count.
    """
    system, fit = problem.system, problem.split.fit
    count = max(MIN_SAMPLES, math.ceil(COMPARED * len(fit.times)))
    states = simulate(system, starts, problem.times[:count])
    read = ObservationOperator(fit.sensors, system)(states)
    weights = np.sqrt(np.isfinite(fit.values).sum(axis=0) / states.shape[1])
    return read / problem.fit_noise_std() * torch.from_numpy(weights)
