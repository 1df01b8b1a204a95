"""Faults whose samples are not readings of the system: a stuck sensor, and spikes."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from dashred.inference.fit.law import SensorFault
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.sensor_faults.fault import (
    Alternatives,
    CountedParameters,
    Fault,
    count_sensors,
)
from dashred.inference.sensor_faults.linearised_fit import LinearisedFit

# A sample is a spike if it is this many σ off both the prediction and its neighbours.
SPIKE_SIGMAS = 5.0
# If more than this share of a sensor's samples look like spikes, the law is wrong instead. No other
# sensor contradicts a sensor that is alone.
MAX_SPIKE_SHARE, MAX_SHARE_ALONE = 0.2, 0.05
# A group of neighbouring spikes counts as this many parameters.
SPIKE_PARAMETERS = 1.5
# The readings of a stuck sensor scatter by less than this share of the trace's standard deviation.
STUCK_STD_SHARE, MIN_STUCK_SAMPLES = 0.02, 6
# The readings of a sensor that never worked scatter by less than this share of the noise.
DEAD_STD_SHARE = 0.1


def spikes(
    objective: LeastSquaresProblem, linear: LinearisedFit, sensor: int
) -> Iterator[Alternatives]:
    """Yield the spikes of a sensor in one episode: samples that the other sensors contradict."""
    seen = objective.noise.available[:, sensor]
    residual = _residual_without_sensor(objective, linear, sensor)
    sigma = float(objective.noise.std[sensor])
    found = seen & (residual.abs() > SPIKE_SIGMAS * sigma) & _sticks_out(residual, sigma)
    most = MAX_SHARE_ALONE if count_sensors(objective) == 1 else MAX_SPIKE_SHARE
    if 0 < int(found.sum()) <= most * int(seen.sum()):
        groups = int((found & ~torch.cat([torch.zeros_like(found[:1]), found[:-1]])).sum())
        complexity = CountedParameters(SPIKE_PARAMETERS * groups)
        yield (Fault("spikes", sensor, complexity, samples=found),)


def stuck(
    objective: LeastSquaresProblem, linear: LinearisedFit, sensor: int
) -> Iterator[Alternatives]:
    """Yield the fault of a sensor that is stuck from some sample on, if it is."""
    trace = objective.recorded[:, sensor]
    known = torch.nonzero(~trace.isnan()).flatten()
    values, sigma = trace[known], float(objective.noise.std[sensor])
    first = first_stuck_sample(values, sigma)
    if first == len(values):
        return
    samples = torch.zeros(len(trace), dtype=torch.bool)
    samples[known[first:]] = True
    tail = values[first:]
    constant = float(((tail - tail.mean()) / sigma).square().sum())
    yield (Fault("stuck", sensor, CountedParameters(2.0), samples=samples, constant=constant),)


def first_stuck_sample(values: Tensor, sigma: float) -> int:
    """Return the first sample from which a sensor is stuck to the end; their number if never."""
    first = len(values)
    if first < 2 * MIN_STUCK_SAMPLES:
        return first
    size = float(values.std())
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


def spikes_in_units(
    objective: LeastSquaresProblem, fault: Fault, parameters: Tensor, covariance: Tensor
) -> SensorFault:
    """Return the number of spikes."""
    assert fault.samples is not None
    name, _, episode = _place(objective, fault)
    return SensorFault(fault.kind, name, float(fault.samples.sum()), None, None, episode)


def stuck_in_units(
    objective: LeastSquaresProblem, fault: Fault, parameters: Tensor, covariance: Tensor
) -> SensorFault:
    """Return the value at which a sensor is stuck, and since when."""
    assert fault.samples is not None
    name, index, episode = _place(objective, fault)
    value = float(objective.recorded[fault.samples, fault.sensor].nanmean())
    first = int(torch.nonzero(fault.samples)[0])
    begin = float(objective.forward_model.times[first, index])
    return SensorFault(fault.kind, name, value, None, begin, episode)


def _place(objective: LeastSquaresProblem, fault: Fault) -> tuple[str, int, int | None]:
    """Return the sensor's name and the index of the episode; the latter is also None if only one.

    The sensor of a column belongs to one episode.
    """
    block = objective.forward_model.sensors
    columns = block.columns_of(fault.sensor)
    index = columns.index(fault.sensor)
    return block.sensors[fault.sensor].name, index, index if len(columns) > 1 else None


def _residual_without_sensor(
    objective: LeastSquaresProblem, linear: LinearisedFit, sensor: int
) -> Tensor:
    """Return readings minus their prediction by the other sensors, in units, ``(time,)``."""
    columns = objective.forward_model.sensors.columns_of(sensor)
    removed = torch.zeros(objective.recorded.shape, dtype=torch.bool)
    removed[:, columns] = True
    residual = linear.residual_without(removed.flatten()).reshape(-1, len(columns))
    return residual[:, columns.index(sensor)] * objective.noise.std[sensor]


def _sticks_out(residual: Tensor, sigma: float) -> Tensor:
    """Tell which samples differ from their neighbours, because a law's error is smooth in time."""
    before = torch.cat([residual[1:2], residual[:-1]])
    after = torch.cat([residual[1:], residual[-2:-1]])
    return (residual - (before + after) / 2).abs() > SPIKE_SIGMAS * sigma
