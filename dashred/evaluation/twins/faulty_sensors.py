"""The readings of faulty sensors, and autocorrelated noise."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dashred.data.sensors import Sensor, SystemDescription

# A sensor that spikes does so at every such part of the record.
SPIKES = 7


class SensorFault(Protocol):
    """What is wrong with a sensor; see :class:`dashred.evaluation.twins.sealing.SealedFault`."""

    @property
    def sensor(self) -> str:
        """Its name."""

    @property
    def kind(self) -> str:
        """``bias``, ``drift``, ``stuck``, ``spikes`` or ``misplaced``."""

    @property
    def value(self) -> float:
        """How much, how fast, from when on, or how far."""


def correlated(white: NDArray[np.float64], correlation: float) -> NDArray[np.float64]:
    """Return noise of unit variance, ``e_t = ρ e_{t-1} + √(1-ρ²) η_t``, from white noise η."""
    found = white.copy()
    for i in range(1, len(found)):
        found[i] = correlation * found[i - 1] + math.sqrt(1 - correlation**2) * white[i]
    return found


def moved(sensor: Sensor, faults: Iterable[SensorFault], system: SystemDescription) -> Sensor:
    """Return the sensor where it really stands: along the first axis off its stated place."""
    for fault in faults:
        if fault.sensor == sensor.name and fault.kind == "misplaced":
            first, *rest = sensor.position
            place = system.axes[0].wrap(first + fault.value)
            return replace(sensor, position=(place, *rest))
    return sensor


def reported(
    read: NDArray[np.float64],
    times: NDArray[np.float64],
    sensor: Sensor,
    faults: Iterable[SensorFault],
) -> NDArray[np.float64]:
    """Return what a sensor reports of what it reads, ``(time,)``."""
    values = read.copy()
    for fault in faults:
        if fault.sensor != sensor.name:
            continue
        if fault.kind == "bias":
            values += fault.value
        elif fault.kind == "drift":
            values += fault.value * (times - times[0])
        elif fault.kind == "stuck":
            begin = int(np.searchsorted(times, fault.value))
            values[begin:] = values[begin]
        elif fault.kind == "spikes":
            values[len(values) // SPIKES :: len(values) // SPIKES] += fault.value
    return values
