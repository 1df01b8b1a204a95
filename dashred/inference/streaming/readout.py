"""What sensors and further quantities read of the states of a live estimator."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor
from dashred.inference.observer.march import March, points_of
from dashred.physics.system import System

Array = NDArray[np.float64]


class Readout:
    """The quantities of states ``(state, field*point)``: ``(state, quantity)``.

    Args:
        march: of the simulator.
        system: the simulator.
        quantities: sensors, and further quantities.
    """

    def __init__(self, march: March, system: System, quantities: Sequence[Sensor]) -> None:
        self.operator = ObservationOperator(tuple(quantities), system)
        self._march = march
        self._matrix = _matrix(self.operator, system)

    def __call__(self, states: Array, time: float) -> Array:
        """Return the quantities at a time."""
        if self._matrix is not None:
            return states @ self._matrix
        return self.operator(self._march.on_grid(states), time).numpy()


def _matrix(operator: ObservationOperator, system: System) -> Array | None:
    """Return H as a matrix ``(field*point, quantity)``; None if it is not linear."""
    if any(sensor.reads not in system.fields for sensor in operator.sensors):
        return None
    shape = (len(system.fields), *points_of(system))
    units = torch.eye(math.prod(shape), dtype=torch.float64)
    return operator(system.grid.ring(units.reshape(-1, *shape))).numpy()
