"""Readings of faulty sensors, and autocorrelated noise."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dashred.data.sensors import Sensor, SystemDescription

# Divisor of the record length that gives the interval between spikes, in samples.
SPIKE_COUNT = 7
# A wandering sensor errs by a sine wave of this many periods over the record.
WANDERING_PERIODS = 1.3


class SensorFault(Protocol):
    """A sensor fault; see :class:`dashred.evaluation.twins.sealing.SealedFault`."""

    @property
    def sensor(self) -> str:
        """Name of the sensor."""

    @property
    def kind(self) -> str:
        """A key of :data:`dashred.core.findings.fault_kinds.FAULT_KINDS`."""

    @property
    def value(self) -> float:
        """Size of a bias, spike or wandering, rate of a drift, time of getting stuck, or shift."""


def autocorrelated_noise(white: NDArray[np.float64], correlation: float) -> NDArray[np.float64]:
    """Return unit-variance AR(1) noise ``e_t = ρ e_{t-1} + √(1-ρ²) η_t`` from white noise η."""
    noise = white.copy()
    for i in range(1, len(noise)):
        noise[i] = correlation * noise[i - 1] + math.sqrt(1 - correlation**2) * white[i]
    return noise


def displaced(sensor: Sensor, faults: Iterable[SensorFault], system: SystemDescription) -> Sensor:
    """Return the sensor at its true position, displaced along the first axis if it is misplaced."""
    for fault in faults:
        if fault.sensor == sensor.name and fault.kind == "misplaced":
            first, *rest = sensor.position
            place = system.axes[0].wrap(first + fault.value)
            return replace(sensor, position=(place, *rest))
    return sensor


def faulty_readings(
    read: NDArray[np.float64],
    times: NDArray[np.float64],
    sensor: Sensor,
    faults: Iterable[SensorFault],
) -> NDArray[np.float64]:
    """Return the readings of a sensor with its faults, ``(time,)``."""
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
            values[len(values) // SPIKE_COUNT :: len(values) // SPIKE_COUNT] += fault.value
        elif fault.kind == "wandering":
            share = (times - times[0]) / (times[-1] - times[0])
            values += fault.value * np.sin(2 * np.pi * WANDERING_PERIODS * share)
    return values
