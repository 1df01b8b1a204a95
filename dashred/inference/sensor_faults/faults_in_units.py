"""Fitted faults in the user's units."""

from __future__ import annotations

from collections.abc import Sequence

from dashred.inference.fit.law import SensorFault
from dashred.inference.fit.least_squares import LeastSquaresProblem, NormalEquations
from dashred.inference.sensor_faults.fault import Fault
from dashred.inference.sensor_faults.fault_table import fault_in_units


def faults_in_units(
    objective: LeastSquaresProblem, faults: Sequence[Fault], normal: NormalEquations
) -> tuple[SensorFault, ...]:
    """Return faults in the user's units, with their standard deviations.

    Args:
        objective: F, whose last unknowns are the parameters of the faults.
        faults: the faults.
        normal: F linearised at its minimum.
    """
    covariance = normal.covariance(range(len(normal.phi)))
    counts = [len(fault.errors.scales) if fault.errors else 0 for fault in faults]
    first, found = len(normal.phi) - sum(counts), []
    for fault, count in zip(faults, counts, strict=True):
        own = slice(first, first + count)
        found.append(fault_in_units(objective, fault, normal.phi[own], covariance[own, own]))
        first += count
    return tuple(found)
