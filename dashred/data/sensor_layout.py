"""Where the sensors of a twin stand: drawn, for nobody has put them anywhere."""

from __future__ import annotations

import numpy as np

from dashred.config import Config
from dashred.core.errors import InputError
from dashred.data.sensor_spacing import spread_out
from dashred.data.sensors import Described, Sensor


def place_sensors(system: Described, config: Config, rng: np.random.Generator) -> list[Sensor]:
    """Draw places for the fit sensors, and for the validation and test sensors on top.

    Each place is the best of 20 random ones, so that sensors keep a distance but no pattern.
    An ODE system has no places: its sensors read their quantities, over and over.
    """
    count, reads = config.recording.sensors, config.recording.reads
    if not isinstance(count, int):
        raise InputError("a twin's sensors are a number", where=config.where("recording.sensors"))
    if not system.axes:
        return [Sensor(_name(i, count), reads[i % len(reads)], (), None) for i in range(count)]
    for role in ("validate", "test"):
        extra = getattr(config.splits.sensors, role)
        count += extra if isinstance(extra, int) else len(extra)
    lengths = np.array([axis.length for axis in system.axes])
    candidates = rng.random((20 * count, len(lengths))) * lengths
    chosen = spread_out(candidates, count, rng, candidates=range(len(candidates)))
    order = sorted(tuple(candidates[i].tolist()) for i in chosen)
    return [
        Sensor(_name(i, count), reads[i % len(reads)], place, None) for i, place in enumerate(order)
    ]


def _name(index: int, count: int) -> str:
    return f"s{index + 1:0{len(str(count))}d}"
