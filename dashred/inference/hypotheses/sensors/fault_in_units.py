"""Sensor faults in the user's units, with standard deviations."""

from __future__ import annotations

import torch
from torch import Tensor

from dashred.inference.fit.law import SensorFault
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.hypotheses.sensors.faults import Fault, FittedFault


def fitted_fault_in_units(objective: LeastSquaresProblem, fitted_fault: FittedFault) -> SensorFault:
    """Return a fitted fault in the user's units.

    Args:
        objective: F of the law, without the fault.
        fitted_fault: the fault, fitted together with the law.
    """
    first = objective.modes + len(objective.prior_std)
    fitted = fitted_fault.fitted
    normal = fitted_fault.objective.linearise(fitted.phi, fitted.readings)
    stds = normal.covariance(range(len(fitted.phi))).diagonal().sqrt()
    return fault_in_units(objective, fitted_fault.fault, fitted.phi[first:], stds[first:])


def fault_in_units(
    objective: LeastSquaresProblem, fault: Fault, parameters: Tensor, stds: Tensor
) -> SensorFault:
    """Return a fault in the user's units.

    Args:
        objective: F of the law.
        fault: the fault.
        parameters: its parameters, ``(parameter,)``.
        stds: their standard deviations, ``(parameter,)``.
    """
    times = objective.forward_model.times
    block = objective.forward_model.sensors
    name = block.sensors[fault.sensor].name
    if not len(parameters):
        columns = block.columns_of(fault.sensor)
        index = columns.index(fault.sensor)
        episode = index if len(columns) > 1 else None
        if fault.kind == "spikes":
            count = float(fault.samples.sum())
            return SensorFault(fault.kind, name, count, None, None, episode)
        tail = objective.recorded[fault.samples, fault.sensor]
        first = int(torch.nonzero(fault.samples)[0])
        start_time = float(times[first, index])
        return SensorFault(fault.kind, name, float(tail.nanmean()), None, start_time, episode)
    length = float((times - times[0]).max()) if fault.kind == "drift" else 1.0
    value = float(parameters[0]) if len(parameters) == 1 else float(parameters.norm())
    return SensorFault(fault.kind, name, value / length, float(stds.norm()) / length, None)
