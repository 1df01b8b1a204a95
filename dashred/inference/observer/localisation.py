"""Localisation: a gain from few simulations must not use sensors that are far away."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from dashred.data.sensors import Sensor
from dashred.inference.initial_state.covariance_tapers import (
    distances,
    gaspari_cohn,
    sensor_distances,
)
from dashred.inference.observer.march import points_of
from dashred.physics.system import System

Array = NDArray[np.float64]

# Simulations for each sensor that a gain may use at one point.
PER_SENSOR = 8


def used_sensors(sensors: int, simulations: int) -> int:
    """Return how many sensors the gain at one point may use."""
    return min(sensors, max(1, simulations // PER_SENSOR))


def radius_for(system: System, sensors: int, simulations: int) -> float:
    """Return the Gaspari–Cohn radius r with so many sensors within 2r; infinite for all of them.

    Args:
        system: with the axes, on which the sensors are taken to be spread evenly.
        sensors: their number.
        simulations: number of simulations from which the covariances come.
    """
    share = used_sensors(sensors, simulations) / max(1, sensors)
    if share >= 1 or not system.axes:
        return math.inf
    volume = share * math.prod(axis.length for axis in system.axes)
    return volume / 4 if len(system.axes) == 1 else math.sqrt(volume / math.pi) / 2


def sensor_tapers(
    system: System, sensors: Sequence[Sensor], quantities: Sequence[Sensor], radius: float
) -> Array:
    """Return the factors of the covariances, ``(sensor, quantity and field*point)``.

    Args:
        system: with the axes.
        sensors: first ones of the quantities.
        quantities: sensors, and further quantities.
        radius: about each sensor; infinite for factors of one.
    """
    count = len(quantities) + len(system.fields) * math.prod(points_of(system))
    if not system.axes or not math.isfinite(radius):
        return np.ones((len(sensors), count))
    places = torch.tensor([s.position for s in quantities], dtype=torch.float64)
    between = sensor_distances(system.grid, places)[: len(sensors)]
    apart = distances(system.grid, places[: len(sensors)])
    apart = system.grid.own(apart.expand(len(sensors), *system.grid.shape)).flatten(1)
    parts = [
        gaspari_cohn(between, radius),
        gaspari_cohn(apart, radius).repeat(1, len(system.fields)),
    ]
    return torch.cat(parts, dim=1).numpy()
