"""Which sensors may be at fault, and how: by what the other sensors say of each."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem, NormalEquations
from dashred.inference.fit.normal_equations import solve
from dashred.inference.hypotheses.sensors.faults import Fault

# A sample this many σ off what the other sensors and neighbours say is a spike.
SPIKE = 5.0
# More than this share of a sensor's samples are no spikes: it is the law that errs.
MOST_SPIKES = 0.2
# A stuck sensor's readings scatter by less than this share of the trace's std.
STILL, LEAST_STUCK = 0.02, 6
# One that never worked shows less than this share of the noise.
DEAD = 0.1


def suspects(objective: LeastSquaresProblem, normal: NormalEquations) -> Iterator[Fault]:
    """Yield the faults that each sensor may have, by what the other sensors say of it.

    Args:
        objective: F of a law that may be right.
        normal: linearised about its fit.
    """
    shape = objective.recorded.shape
    seen = objective.noise.available
    none = torch.zeros(shape[0], dtype=torch.bool)
    for sensor in range(shape[1]):
        rest = _without(objective, normal, sensor)
        if objective.forward_model.sensors.columns_of(sensor)[0] == sensor:
            yield from _in_all_episodes(objective, sensor, none)
        sigma = float(objective.noise.std[sensor])
        yield from _stuck(objective, sensor)
        spikes = seen[:, sensor] & (rest.abs() > SPIKE * sigma) & _alone(rest, sigma)
        if 0 < int(spikes.sum()) <= MOST_SPIKES * int(seen[:, sensor].sum()):
            groups = int((spikes & ~torch.cat([none[:1], spikes[:-1]])).sum())
            yield Fault("spikes", sensor, spikes, parameters=1.5 * groups)


def _in_all_episodes(objective: LeastSquaresProblem, sensor: int, none: Tensor) -> Iterator[Fault]:
    """Yield the faults that a sensor has in every episode."""
    yield Fault("bias", sensor, none)
    yield Fault("drift", sensor, none)
    axes = objective.forward_model.simulator.system.axes
    if axes:
        yield Fault("misplaced", sensor, none, parameters=float(len(axes)))


def _without(objective: LeastSquaresProblem, normal: NormalEquations, sensor: int) -> Tensor:
    """Return what one sensor reads beyond what the others let expect, in its unit, ``(time,)``."""
    shape = objective.recorded.shape
    jacobian = normal.jacobian.reshape(*shape, -1)
    target = normal.target.reshape(shape)
    own = objective.forward_model.sensors.columns_of(sensor)
    others = [s for s in range(shape[1]) if s not in own]
    rows, goal = jacobian[:, others].flatten(0, 1), target[:, others].flatten()
    matrix = rows.T @ rows + torch.diag(normal.precision)
    phi = solve(matrix, (rows.T @ goal)[:, None])[:, 0]
    left = target[:, sensor] - jacobian[:, sensor] @ phi
    found: Tensor = left * objective.noise.std[sensor]
    return found


def _alone(rest: Tensor, sigma: float) -> Tensor:
    """Tell which samples stick out of their neighbours, too: a law's error is smooth in time."""
    before = torch.cat([rest[1:2], rest[:-1]])
    after = torch.cat([rest[1:], rest[-2:-1]])
    return (rest - (before + after) / 2).abs() > SPIKE * sigma


def _stuck(objective: LeastSquaresProblem, sensor: int) -> Iterator[Fault]:
    """Yield the time from which on a sensor repeats itself, if it does."""
    trace = objective.recorded[:, sensor]
    known = torch.nonzero(~trace.isnan()).flatten()
    if len(known) < 2 * LEAST_STUCK:
        return
    values, sigma = trace[known], float(objective.noise.std[sensor])
    first = _still_from(values, sigma)
    if first == len(values):
        return
    samples = torch.zeros(len(trace), dtype=torch.bool)
    samples[known[first:]] = True
    tail = values[first:]
    constant = float(((tail - tail.mean()) / sigma).square().sum())
    yield Fault("stuck", sensor, samples, constant, 2.0)


def _still_from(values: Tensor, sigma: float) -> int:
    """Return from which sample on a sensor repeats itself to the end; their number, if never."""
    size, first = float(values.std()), len(values)
    if size < DEAD * sigma:
        return 0
    if size <= 3 * sigma:
        return first
    # A sensor that gives up keeps its last value to the end, with the noise of reading it or not.
    for begin in range(len(values) - LEAST_STUCK, 0, -1):
        tail = values[begin:]
        if float(tail.std()) > max(STILL * size, 1.3 * sigma):
            break
        first = begin
    return first
