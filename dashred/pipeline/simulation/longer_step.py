"""Choose the time step of the ensemble and of derivatives, which may be less accurate."""

from __future__ import annotations

import torch
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.physics.runs.step_stability import Along, is_stable
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import NominalRun

# Steps that are tried, in units of the simulator's own, and the change of a trace that is harmless,
# as a share of its std.
FACTORS, LIMIT = (2.0, 4.0, 8.0), 0.01
# Samples of a segment, and the largest number of segments that are simulated.
SAMPLES, MOST_SEGMENTS = 3, 5


@torch.no_grad()
def with_longer_step(problem: Problem, nominal: NominalRun) -> Problem:
    """Return the problem with the longest stable time step that changes the readings little.

    The changes of short segments are added up over the record, because a chaotic simulation
    amplifies any difference. What a step that is too long amplifies does not show in them. A step
    that the configuration states is kept.

    Args:
        problem: recording and settings.
        nominal: simulation along which the segments start.
    """
    if problem.config.simulation.dt is not None:
        return problem
    system, path = problem.system, nominal.references[0]
    own = _ends_of_segments(problem, path, system)
    std = ObservationOperator(problem.split.fit.sensors, system)(path).std(dim=0)
    count = (len(path) - 1) / SAMPLES
    interval = float(problem.times.diff().min())
    accurate = []
    for factor in FACTORS:
        dt = factor * system.dt
        if dt > 1.001 * interval:
            break
        change = _ends_of_segments(problem, path, system.with_step(dt)) - own
        error = count * change.square().mean(dim=0).sqrt() / std.clamp(min=1e-300)
        # Written with "not", because the values may be NaN.
        if not float(error.max()) < LIMIT:
            break
        accurate.append(dt)
    middle = len(path) // 2
    along = Along(
        path[middle : middle + 1],
        problem.times[middle : middle + 1],
        float(problem.times[-1]),
        float(problem.times[-1] - problem.times[0]),
    )
    for dt in reversed(accurate):
        # Most programs choose their own stable steps, and a call may take long.
        if system.program is not None or is_stable(system.with_step(dt), along):
            return problem.with_longer_step(dt)
    return problem


def _ends_of_segments(problem: Problem, path: Tensor, system: System) -> Tensor:
    """Return the readings at the ends of some segments of a path, ``(segment, sensor)``."""
    operator, times = ObservationOperator(problem.split.fit.sensors, system), problem.times
    stride = SAMPLES * -(-(len(path) - 1) // (SAMPLES * MOST_SEGMENTS))
    ends = []
    for first in range(0, len(path) - SAMPLES, stride):
        clock = times[first : first + SAMPLES + 1]
        states = simulate(system, path[first : first + 1], clock)
        ends.append(operator(states[0, -1:])[0])
    return torch.stack(ends)
