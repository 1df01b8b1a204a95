"""Is the simulator resolved where the recording begins, too?

Before anything is fitted, the resolution is checked from the simulator's own start
(:mod:`dashred.physics.runs.resolution`). A recording may begin far from that, where the same step
is too long: what the simulator gets wrong there could pass for physics that acts at large values
alone.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.inference.fit.law import Law
from dashred.inference.results.corrected_system import correct
from dashred.physics.runs.resolution import refine
from dashred.physics.solvers.simulate import simulate
from dashred.pipeline.problem import Problem

# How much of the fit is looked at: later on, in chaos, every difference grows.
BEGINNING, FEWEST = 0.1, 4
# More than that is no longer a number to compare.
LARGEST = 1e6


@torch.no_grad()
def numerical_error(problem: Problem, law: Law, noise: Tensor) -> float:
    """Return the largest error of the corrected simulator, in standard deviations of the noise.

    It is the rms over the sensors of ``(H x − H x_fine)/σ`` in the sample where that is largest,
    x the corrected run from the start that was fitted, x_fine the same at doubled resolution; of
    the worst episode, in the beginning of the fit.

    Args:
        problem: the simulator and the episodes.
        law: what was found.
        noise: σ under which it was, ``(sensor,)``: all that it leaves, which may be more than the
            sensors' own noise. What is small beside that is not what the law lacks.
    """
    starts = problem.starts(law.start)
    return max(_error(e, law, s, noise) for e, s in zip(problem.episodes, starts, strict=True))


def _error(problem: Problem, law: Law, start: Tensor, noise: Tensor) -> float:
    fitted = len(problem.split.fit.times)
    times = problem.times[: max(FEWEST, math.ceil(BEGINNING * fitted))]
    own = correct(problem.system, law)
    runs = ((own, start[None]), refine(own, start[None]))
    sensors = problem.split.fit.sensors
    coarse, fine = (ObservationOperator(sensors, s)(simulate(s, z, times)) for s, z in runs)
    wrong = (coarse - fine)[0] / noise
    largest = wrong.square().mean(dim=-1).sqrt().max()
    return float(largest.nan_to_num(nan=LARGEST).clamp(max=LARGEST))
