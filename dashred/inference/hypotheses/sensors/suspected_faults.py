"""Suspected sensor faults: readings that disagree with what the other sensors predict."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem, NormalEquations
from dashred.inference.fit.normal_equations import solve
from dashred.inference.hypotheses.sensors.faults import Fault

# A sample is a spike if it is this many σ off both the prediction and its neighbours.
SPIKE_SIGMAS = 5.0
# If more than this share of a sensor's samples look like spikes, the law is wrong instead.
MAX_SPIKE_SHARE = 0.2
# The readings of a stuck sensor scatter by less than this share of the trace's standard deviation.
STUCK_STD_SHARE, MIN_STUCK_SAMPLES = 0.02, 6
# The readings of a sensor that never worked scatter by less than this share of the noise.
DEAD_STD_SHARE = 0.1


def find_suspected_faults(
    objective: LeastSquaresProblem, normal: NormalEquations
) -> Iterator[Fault]:
    """Yield the faults that each sensor may have, judged by the other sensors.

    Args:
        objective: F of a law that may be right.
        normal: F linearised about its fit.
    """
    shape = objective.recorded.shape
    seen = objective.noise.available
    no_samples = torch.zeros(shape[0], dtype=torch.bool)
    for sensor in range(shape[1]):
        residual = _residual_without_sensor(objective, normal, sensor)
        if objective.forward_model.sensors.columns_of(sensor)[0] == sensor:
            yield from _persistent_faults(objective, sensor, no_samples)
        sigma = float(objective.noise.std[sensor])
        yield from _find_stuck(objective, sensor)
        spikes = (
            seen[:, sensor] & (residual.abs() > SPIKE_SIGMAS * sigma) & _sticks_out(residual, sigma)
        )
        if 0 < int(spikes.sum()) <= MAX_SPIKE_SHARE * int(seen[:, sensor].sum()):
            groups = int((spikes & ~torch.cat([no_samples[:1], spikes[:-1]])).sum())
            yield Fault("spikes", sensor, spikes, parameter_count=1.5 * groups)


def _persistent_faults(
    objective: LeastSquaresProblem, sensor: int, no_samples: Tensor
) -> Iterator[Fault]:
    """Yield the faults that affect all episodes of a sensor."""
    yield Fault("bias", sensor, no_samples)
    yield Fault("drift", sensor, no_samples)
    axes = objective.forward_model.simulator.system.axes
    if axes:
        yield Fault("misplaced", sensor, no_samples, parameter_count=float(len(axes)))


def _residual_without_sensor(
    objective: LeastSquaresProblem, normal: NormalEquations, sensor: int
) -> Tensor:
    """Return readings minus their prediction by the other sensors, in units, ``(time,)``."""
    shape = objective.recorded.shape
    jacobian = normal.jacobian.reshape(*shape, -1)
    target = normal.target.reshape(shape)
    own_columns = objective.forward_model.sensors.columns_of(sensor)
    others = [s for s in range(shape[1]) if s not in own_columns]
    rows, goal = jacobian[:, others].flatten(0, 1), target[:, others].flatten()
    matrix = rows.T @ rows + torch.diag(normal.precision)
    phi = solve(matrix, (rows.T @ goal)[:, None])[:, 0]
    residual = target[:, sensor] - jacobian[:, sensor] @ phi
    in_units: Tensor = residual * objective.noise.std[sensor]
    return in_units


def _sticks_out(residual: Tensor, sigma: float) -> Tensor:
    """Tell which samples differ from their neighbours, because a law's error is smooth in time."""
    before = torch.cat([residual[1:2], residual[:-1]])
    after = torch.cat([residual[1:], residual[-2:-1]])
    return (residual - (before + after) / 2).abs() > SPIKE_SIGMAS * sigma


def _find_stuck(objective: LeastSquaresProblem, sensor: int) -> Iterator[Fault]:
    """Yield the fault of a sensor that is stuck from some sample on, if it is."""
    trace = objective.recorded[:, sensor]
    known = torch.nonzero(~trace.isnan()).flatten()
    if len(known) < 2 * MIN_STUCK_SAMPLES:
        return
    values, sigma = trace[known], float(objective.noise.std[sensor])
    first = _first_stuck_sample(values, sigma)
    if first == len(values):
        return
    samples = torch.zeros(len(trace), dtype=torch.bool)
    samples[known[first:]] = True
    tail = values[first:]
    constant = float(((tail - tail.mean()) / sigma).square().sum())
    yield Fault("stuck", sensor, samples, constant, 2.0)


def _first_stuck_sample(values: Tensor, sigma: float) -> int:
    """Return the first sample from which a sensor is stuck to the end; their number if never."""
    size, first = float(values.std()), len(values)
    if size < DEAD_STD_SHARE * sigma:
        return 0
    if size <= 3 * sigma:
        return first
    # A stuck sensor keeps its last value to the end, with or without noise.
    for begin in range(len(values) - MIN_STUCK_SAMPLES, 0, -1):
        tail = values[begin:]
        if float(tail.std()) > max(STUCK_STD_SHARE * size, 1.3 * sigma):
            break
        first = begin
    return first
