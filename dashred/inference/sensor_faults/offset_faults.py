"""Faults that shift the readings of a sensor: a bias, a drift, a wandering error, a position."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from dashred.inference.fit.law import SensorFault
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.forward.sensor_block import OffsetErrors, PositionErrors
from dashred.inference.sensor_faults.error_curve import curve_errors, error_curves
from dashred.inference.sensor_faults.fault import (
    Alternatives,
    CountedParameters,
    Fault,
    MarginalAmplitudes,
    count_sensors,
)
from dashred.inference.sensor_faults.linearised_fit import LinearisedFit

# With fewer sensors none can be said to wander: a curve could explain whatever is missing.
MIN_SENSORS = 3


def bias(
    objective: LeastSquaresProblem, linear: LinearisedFit, sensor: int
) -> Iterator[Alternatives]:
    """Yield a constant error, the same in all episodes."""
    yield from _offset(objective, "bias", sensor, torch.ones_like(objective.forward_model.times))


def drift(
    objective: LeastSquaresProblem, linear: LinearisedFit, sensor: int
) -> Iterator[Alternatives]:
    """Yield an error that grows linearly from zero in every episode."""
    elapsed = objective.forward_model.times - objective.forward_model.times[0]
    yield from _offset(objective, "drift", sensor, elapsed / elapsed.max())


def wandering(
    objective: LeastSquaresProblem, linear: LinearisedFit, sensor: int
) -> Iterator[Alternatives]:
    """Yield an error that wanders slowly, as one alternative for each size of the wandering."""
    block = objective.forward_model.sensors
    is_first = block.columns_of(sensor)[0] == sensor
    if not is_first or count_sensors(objective) < MIN_SENSORS:
        return
    curves = curve_errors(
        objective.forward_model.times,
        block.columns_of(sensor),
        len(block.sensors),
        _trace_std(objective, sensor),
        float(objective.noise.std[sensor]),
    )
    yield tuple(
        Fault("wandering", sensor, MarginalAmplitudes(errors.scales, len(curves)), errors=errors)
        for errors in curves
    )


def misplaced(
    objective: LeastSquaresProblem, linear: LinearisedFit, sensor: int
) -> Iterator[Alternatives]:
    """Yield a wrong position, the same in all episodes."""
    forward_model, block = objective.forward_model, objective.forward_model.sensors
    columns, system = block.columns_of(sensor), forward_model.simulator.system
    if columns[0] == sensor and system.axes:
        errors = PositionErrors(block.sensors[sensor], columns, system)
        yield (Fault("misplaced", sensor, CountedParameters(len(system.axes)), errors=errors),)


def bias_in_units(
    objective: LeastSquaresProblem, fault: Fault, parameters: Tensor, covariance: Tensor
) -> SensorFault:
    """Return a bias in the unit of the readings."""
    return _sized(objective, fault, parameters, covariance, 1.0)


def drift_in_units(
    objective: LeastSquaresProblem, fault: Fault, parameters: Tensor, covariance: Tensor
) -> SensorFault:
    """Return a drift per unit time."""
    times = objective.forward_model.times
    return _sized(objective, fault, parameters, covariance, float((times - times[0]).max()))


def wandering_in_units(
    objective: LeastSquaresProblem, fault: Fault, parameters: Tensor, covariance: Tensor
) -> SensorFault:
    """Return the error curves of a wandering sensor, and its largest error."""
    assert isinstance(fault.errors, OffsetErrors)
    times, block = objective.forward_model.times, objective.forward_model.sensors
    columns = block.columns_of(fault.sensor)
    curves = error_curves(fault.errors, times, columns, parameters, covariance)
    pairs = [pair for each in curves for pair in zip(each.value, each.std, strict=True)]
    value, std = max(pairs, key=lambda pair: abs(pair[0]))
    name = block.sensors[fault.sensor].name
    return SensorFault(fault.kind, name, value, std, None, curves=curves)


def misplaced_in_units(
    objective: LeastSquaresProblem, fault: Fault, parameters: Tensor, covariance: Tensor
) -> SensorFault:
    """Return the distance from the stated position."""
    return _sized(objective, fault, parameters, covariance, 1.0)


def _offset(
    objective: LeastSquaresProblem, kind: str, sensor: int, shape: Tensor
) -> Iterator[Alternatives]:
    """Yield an error of a known shape, ``(time, episode)``, and unknown size."""
    columns = objective.forward_model.sensors.columns_of(sensor)
    if columns[0] != sensor:
        return
    pattern = torch.zeros((1, *objective.recorded.shape), dtype=torch.float64)
    pattern[0, :, columns] = shape
    scale = torch.tensor([_trace_std(objective, sensor)], dtype=torch.float64)
    yield (Fault(kind, sensor, CountedParameters(1.0), errors=OffsetErrors(pattern, scale)),)


def _trace_std(objective: LeastSquaresProblem, sensor: int) -> float:
    """Return the standard deviation of the trace of a sensor; of its noise if it is constant."""
    traces = objective.recorded[:, objective.forward_model.sensors.columns_of(sensor)]
    size = float(traces[~traces.isnan()].std())
    return size if size > 0 else float(objective.noise.std[sensor])


def _sized(
    objective: LeastSquaresProblem,
    fault: Fault,
    parameters: Tensor,
    covariance: Tensor,
    length: float,
) -> SensorFault:
    name = objective.forward_model.sensors.sensors[fault.sensor].name
    value = float(parameters[0]) if len(parameters) == 1 else float(parameters.norm())
    std = float(covariance.diagonal().clamp(min=0).sum().sqrt())
    return SensorFault(fault.kind, name, value / length, std / length, None)
