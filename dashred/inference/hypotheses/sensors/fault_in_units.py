"""A sensor's fault that was found, in the user's units and with its error."""

from __future__ import annotations

import torch
from torch import Tensor

from dashred.inference.fit.law import SensorFault
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.hypotheses.sensors.faults import Fault, FittedFault


def fitted_fault_in_units(objective: LeastSquaresProblem, tested: FittedFault) -> SensorFault:
    """Return what was found to be wrong with the sensor of a fitted fault, in the user's units.

    Args:
        objective: F of the law, without the fault.
        tested: the fault, with F of both.
    """
    first = objective.modes + len(objective.prior_std)
    normal = tested.objective.linearise(tested.fitted.phi, tested.fitted.readings)
    stds = normal.covariance(range(len(tested.fitted.phi))).diagonal().sqrt()
    return fault_in_units(objective, tested.fault, tested.fitted.phi[first:], stds[first:])


def fault_in_units(
    objective: LeastSquaresProblem, fault: Fault, own: Tensor, stds: Tensor
) -> SensorFault:
    """Return what is wrong with a sensor, in the user's units.

    Args:
        objective: F of the law.
        fault: what it is.
        own: the numbers that describe it, ``(number,)``.
        stds: their standard deviations.
    """
    times = objective.forward_model.times
    block = objective.forward_model.sensors
    name = block.sensors[fault.sensor].name
    if not len(own):
        columns = block.columns_of(fault.sensor)
        index = columns.index(fault.sensor)
        episode = index if len(columns) > 1 else None
        if fault.kind == "spikes":
            count = float(fault.samples.sum())
            return SensorFault(fault.kind, name, count, None, None, episode)
        tail = objective.recorded[fault.samples, fault.sensor]
        first = int(torch.nonzero(fault.samples)[0])
        begin = float(times[first, index])
        return SensorFault(fault.kind, name, float(tail.nanmean()), None, begin, episode)
    length = float((times - times[0]).max()) if fault.kind == "drift" else 1.0
    value = float(own[0]) if len(own) == 1 else float(own.norm())
    return SensorFault(fault.kind, name, value / length, float(stds.norm()) / length, None)
