"""Random positions for the sensors of a twin experiment."""

from __future__ import annotations

import numpy as np

from dashred.config import Config
from dashred.core.errors import InputError
from dashred.data.sensor_spacing import farthest_points
from dashred.data.sensors import Sensor, SystemDescription


def place_sensors(
    system: SystemDescription, config: Config, rng: np.random.Generator
) -> list[Sensor]:
    """Draw positions for the fit sensors and for additional validation and test sensors.

    Positions are chosen by farthest-point sampling from 20 random candidates per sensor, which
    keeps the sensors apart without a regular pattern. The sensors of an ODE system have no
    positions and cycle through the quantities of ``recording.reads``.

    Raises:
        InputError: ``recording.sensors`` is not a number.
    """
    count, reads = config.recording.sensors, config.recording.reads
    if not isinstance(count, int):
        problem = "recording.sensors must be a number of sensors for a twin"
        raise InputError(problem, where=config.where("recording.sensors"))
    if not system.axes:
        return [Sensor(_name(i, count), reads[i % len(reads)], (), None) for i in range(count)]
    for role in ("validate", "test"):
        extra = getattr(config.splits.sensors, role)
        count += extra if isinstance(extra, int) else len(extra)
    lengths = np.array([axis.length for axis in system.axes])
    begins = np.array([axis.begin for axis in system.axes])
    candidates = rng.random((20 * count, len(lengths))) * lengths + begins
    inside = [index for index, place in enumerate(candidates) if system.contains(place)]
    chosen = farthest_points(candidates, count, rng, candidates=inside)
    order = sorted(tuple(candidates[i].tolist()) for i in chosen)
    return [
        Sensor(_name(i, count), reads[i % len(reads)], place, None) for i, place in enumerate(order)
    ]


def _name(index: int, count: int) -> str:
    return f"s{index + 1:0{len(str(count))}d}"
