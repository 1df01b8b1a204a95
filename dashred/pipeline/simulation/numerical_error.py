"""Numerical error of the corrected simulator at the start of the recording.

Before any fit, the resolution is checked from the simulator's nominal start
(:mod:`dashred.physics.runs.resolution`). A recording may begin far from that, where the same step
is too long: what the simulator gets error there could pass for physics that acts at large values
alone.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from dashred.core.findings.fit_schema import LARGEST_OWN_ERROR
from dashred.data.observation_operator import ObservationOperator
from dashred.inference.fit.law import Law
from dashred.inference.results.corrected_system import build_corrected_system
from dashred.physics.runs.resolution import simulate_refined
from dashred.physics.solvers.simulate import simulate
from dashred.pipeline.problem import Problem

# How much of the fit is looked at: later on, in chaos, every difference grows.
CHECKED_SHARE, MIN_SAMPLES = 0.1, 4
# The step is halved so many times at most in search of one that suffices.
MAX_HALVINGS = 4
# A smaller error is not visible in the readings. It is systematic: a tenth of σ at some hundreds of
# readings is as large as what proves a term.
VISIBLE = 0.1


@torch.no_grad()
def numerical_error(problem: Problem, law: Law, noise: Tensor) -> float | None:
    """Return the largest numerical error of the corrected simulator, in std of the noise.

    It is the rms over the sensors of ``(H x − H x_fine)/σ``, maximised over the first samples and
    the episodes; x is the corrected run from the fitted start, x_fine the same at doubled
    resolution. None if both diverge: then the law is at fault, and not the resolution.

    Args:
        problem: the simulator and the episodes.
        law: the law.
        noise: σ of the residuals of the law, ``(sensor,)``, which may exceed the sensor noise.
    """
    found = _errors(problem, law, noise, problem.system.dt)
    return None if found is None else max(found)


@torch.no_grad()
def sufficient_step(problem: Problem, law: Law, noise: Tensor) -> float | None:
    """Return a time step with which :func:`numerical_error` is not visible.

    None if no shorter step helps, because the grid is too coarse, or because the method chooses its
    own steps.
    """
    system = problem.system
    if not system.axes and system.tableau is None:
        return None
    for halvings in range(1, MAX_HALVINGS + 1):
        dt = system.dt / 2**halvings
        found = _errors(problem, law, noise, dt)
        if found is not None and max(found) <= VISIBLE:
            return dt
    return None


def _errors(problem: Problem, law: Law, noise: Tensor, dt: float) -> list[float] | None:
    """Return the error in every episode with a time step; None if a run diverges."""
    errors = []
    for episode, start in zip(problem.episodes, law.start, strict=True):
        fitted = len(episode.split.fit.times)
        times = episode.times[: max(MIN_SAMPLES, math.ceil(CHECKED_SHARE * fitted))]
        own = build_corrected_system(episode.system, law).with_step(dt)
        states = simulate(own, start[None], times)
        finer, fine_states = simulate_refined(own, start[None], times)
        if not torch.isfinite(states).all() and not torch.isfinite(fine_states).all():
            return None
        sensors = episode.split.fit.sensors
        coarse = ObservationOperator(sensors, own)(states)
        fine = ObservationOperator(sensors, finer)(fine_states)
        largest = ((coarse - fine)[0] / noise).square().mean(dim=-1).sqrt().max()
        errors.append(float(largest.nan_to_num(nan=LARGEST_OWN_ERROR).clamp(max=LARGEST_OWN_ERROR)))
    return errors
