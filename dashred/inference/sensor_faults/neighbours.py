"""Sensors that are next to each other.

Errors of sensors are independent of their places, and what happens in a field is not. If sensors
that are next to each other seem to err in the same recording, the cause is probably in the field.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from itertools import combinations

from dashred.data.sensors import Sensor
from dashred.physics.grids.grid import Axis


def has_neighbours(
    sensors: Sequence[Sensor], chosen: Collection[Sensor], axes: Sequence[Axis]
) -> bool:
    """Return whether two of the chosen sensors are next to each other and read the same quantity.

    One of them is then among the ``2 · (number of axes)`` nearest sensors of the other.

    Args:
        sensors: all sensors.
        chosen: some of them.
        axes: spatial axes; without axes no sensors are neighbours.
    """
    return any(
        _is_next_to(one, other, sensors, axes) or _is_next_to(other, one, sensors, axes)
        for one, other in combinations(chosen, 2)
        if one.reads == other.reads
    )


def _is_next_to(
    one: Sensor, other: Sensor, sensors: Sequence[Sensor], axes: Sequence[Axis]
) -> bool:
    others = [s for s in sensors if s.reads == one.reads and s.name != one.name]
    near = sorted(others, key=lambda s: _distance(one, s, axes))[: 2 * len(axes)]
    return other.name in {s.name for s in near}


def _distance(one: Sensor, other: Sensor, axes: Sequence[Axis]) -> float:
    squares = []
    for a, b, axis in zip(one.position, other.position, axes, strict=True):
        apart = abs(a - b)
        squares.append(min(apart, axis.length - apart) ** 2 if axis.periodic else apart**2)
    return math.sqrt(sum(squares))
