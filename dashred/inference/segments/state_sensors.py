"""Sensors of an ODE system: expressions of the state, and their derivatives."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dashred.data.sensors import Sensor
from dashred.inference.segments.segments import Array
from dashred.physics.backends.numpy_backend import Pointwise
from dashred.physics.expressions.differentiate import differentiate
from dashred.physics.system import System


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
