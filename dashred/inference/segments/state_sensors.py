"""Sensors of an ODE system: expressions of the state, their derivatives, and their errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dashred.data.sensors import Sensor
from dashred.inference.segments.segments import Array, Segments
from dashred.physics.backends.numpy_backend import Pointwise
from dashred.physics.expressions.differentiate import differentiate
from dashred.physics.system import System


@dataclass(frozen=True)
class SensorError:
    """An error of one sensor with an unknown size.

    Attributes:
        kind: ``bias``, or ``drift`` from the first sample of an episode.
        sensor: index of the sensor.
        scale: natural scale of its size: the std of the trace, per unit time for a drift.
    """

    kind: str
    sensor: int
    scale: float

    def column(self, segments: Segments) -> Array:
        """Return the readings per unit size, ``(segment, sample, sensor)``."""
        found = np.zeros(segments.readings.shape)
        begins = segments.times[segments.begins, 0][segments.episode]
        elapsed = segments.times - begins[:, None]
        found[:, :, self.sensor] = elapsed if self.kind == "drift" else 1.0
        return found

    def __str__(self) -> str:
        """Return the kind and the index of the sensor."""
        return f"{self.kind} of sensor {self.sensor}"


def possible_errors(segments: Segments) -> list[SensorError]:
    """Return a bias and a drift of every sensor; none of a single one: nothing contradicts it."""
    count = segments.readings.shape[-1]
    if count < 2:
        return []
    stds = np.nanstd(segments.readings.reshape(-1, count), axis=0)
    duration = float(np.ptp(segments.times))
    found = []
    for sensor, std in enumerate(stds.tolist()):
        size = max(std, 1e-12)
        found.append(SensorError("bias", sensor, size))
        found.append(SensorError("drift", sensor, size / duration))
    return found


class StateSensors:
    """``y = h(x)`` of every sensor.

    Attributes:
        names: of the sensors.
        fields: index of the field that a sensor reads as it is, ``(sensor,)``; -1 for the others.

    Args:
        sensors: of the recording.
        system: whose state they read.
    """

    def __init__(self, sensors: Sequence[Sensor], system: System) -> None:
        self.names = tuple(sensor.name for sensor in sensors)
        names = list(system.fields)
        reads = [system.resolve(system.parse(s.reads, s.reads), s.reads) for s in sensors]
        self._states = names
        self._values = Pointwise(reads)
        self._slopes = Pointwise([differentiate(expr, name) for expr in reads for name in names])
        self.fields = np.array([names.index(s.reads) if s.reads in names else -1 for s in sensors])

    def read(self, states: Array) -> Array:
        """Return readings ``(…, sensor)`` of states ``(…, field)``."""
        return np.moveaxis(self._values(self._named(states), states.shape[:-1]), 0, -1)

    def slopes(self, states: Array) -> Array:
        """Return the derivatives of the readings, ``(…, sensor, field)``."""
        found = self._slopes(self._named(states), states.shape[:-1])
        return np.moveaxis(found, 0, -1).reshape(*states.shape[:-1], -1, len(self._states))

    def _named(self, states: Array) -> dict[str, Array]:
        return dict(zip(self._states, np.moveaxis(states, -1, 0), strict=True))
