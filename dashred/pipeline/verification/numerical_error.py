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

from dashred.data.observation_operator import ObservationOperator
from dashred.inference.fit.law import Law
from dashred.inference.results.corrected_system import build_corrected_system
from dashred.physics.runs.resolution import simulate_refined
from dashred.physics.solvers.simulate import simulate
from dashred.pipeline.problem import Problem

# How much of the fit is looked at: later on, in chaos, every difference grows.
CHECKED_SHARE, MIN_SAMPLES = 0.1, 4
# More than that is no longer a number to compare.
MAX_ERROR = 1e6


@torch.no_grad()
def numerical_error(problem: Problem, law: Law, noise: Tensor) -> float:
    """Return the largest numerical error of the corrected simulator, in std of the noise.

    It is the rms over the sensors of ``(H x − H x_fine)/σ``, maximised over the first samples and
    the episodes; x is the corrected run from the fitted start, x_fine the same at doubled
    resolution.

    Args:
        problem: the simulator and the episodes.
        law: the law.
        noise: σ of the residuals of the law, ``(sensor,)``, which may exceed the sensor noise.
    """
    episodes = zip(problem.episodes, law.start, strict=True)
    return max(_error(e, law, start, noise) for e, start in episodes)


def _error(problem: Problem, law: Law, start: Tensor, noise: Tensor) -> float:
    fitted = len(problem.split.fit.times)
    times = problem.times[: max(MIN_SAMPLES, math.ceil(CHECKED_SHARE * fitted))]
    own = build_corrected_system(problem.system, law)
    runs = ((own, simulate(own, start[None], times)), simulate_refined(own, start[None], times))
    sensors = problem.split.fit.sensors
    coarse, fine = (ObservationOperator(sensors, system)(states) for system, states in runs)
    error = (coarse - fine)[0] / noise
    largest = error.square().mean(dim=-1).sqrt().max()
    return float(largest.nan_to_num(nan=MAX_ERROR).clamp(max=MAX_ERROR))
