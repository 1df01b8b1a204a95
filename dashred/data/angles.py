"""Readings of angles: they are continued across the full turn."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.core.unit_conversion import conversion
from dashred.data.episodes import Episode, Episodes, name_episode_in_errors
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor, check_named_sensors
from dashred.physics.system import System

# Of the steps between readings, at most this share may be longer than this share of a turn:
# otherwise the turns cannot be counted.
LONG_STEP, MOST_LONG = 0.4, 0.05
# Readings within one turn span at most so many turns.
LARGEST_SPAN = 1.05


def continue_angles(
    system: System, episodes: Episodes, wrapped: Sequence[str], where: str
) -> Episodes:
    """Return a recording in which the readings of angles do not jump by full turns.

    Every reading is moved by full turns to within half a turn of the one before; a single reading
    that is far from those about it does not count as the one before. The first reading
    of an episode is moved to within half a turn of the stated start, if the sensor reads a field
    whose start is a number and the simulator has no spin-up.

    Args:
        system: the simulator.
        episodes: the recording.
        wrapped: ``recording.angles``: sensors, or what they read.
        where: location of this key.

    Raises:
        InputError: a name is neither that of a sensor nor of what one reads, readings span more
            than a turn, or a sensor turns too fast between two readings.
    """
    check_named_sensors(episodes.sensors, wrapped, "recording.angles", where)
    if not wrapped:
        return episodes
    parts = []
    for part in episodes.episodes:
        with name_episode_in_errors(part.name):
            parts.append(Episode(part.name, _continue(system, part.recording, wrapped, where)))
    return replace(episodes, episodes=tuple(parts))


def _continue(
    system: System, recording: Recording, wrapped: Sequence[str], where: str
) -> Recording:
    values, units = recording.values.copy(), dict(recording.units)
    for column, sensor in enumerate(recording.sensors):
        if sensor.name not in wrapped and sensor.reads not in wrapped:
            continue
        turn = _full_turn(system, recording, sensor, where)
        # Without a unit it is in radians, and may be the argument of a sine.
        units.setdefault(sensor.reads, system.units.get(sensor.reads, "rad"))
        seen = np.isfinite(values[:, column])
        _check_span(sensor, values[seen, column], turn, where)
        continued = _unwrap(values[seen, column], turn)
        _check_steps(sensor, continued, turn, where)
        start = _stated_start(system, sensor)
        if start is not None and len(continued):
            continued = continued - turn * round((continued[0] - start) / turn)
        values[seen, column] = continued
    return replace(recording, values=values, units=units)


def _full_turn(system: System, recording: Recording, sensor: Sensor, where: str) -> float:
    """Return a full turn in the unit of the readings; angles without a unit are in radians."""
    unit = system.units.get(sensor.reads) or recording.units.get(sensor.reads)
    if unit is None:
        return 2 * math.pi
    what = f"a full turn of sensor {sensor.name!r}"
    return float(conversion(what, "rad", where, unit, f"the unit of {sensor.reads}")(2 * math.pi))


def _unwrap(values: NDArray[np.float64], turn: float) -> NDArray[np.float64]:
    """Return values without jumps by full turns."""
    found = values.copy()
    before, last = float(found[0]) if len(found) else 0.0, len(found) - 1
    for i, value in enumerate(values.tolist()):
        found[i] = value - turn * round((value - before) / turn)
        # A spike would otherwise shift all later readings by a turn.
        is_spike = abs(found[i] - before) > LONG_STEP * turn and (
            i < last and abs(math.remainder(float(values[i + 1]) - before, turn)) < LONG_STEP * turn
        )
        before = before if is_spike else float(found[i])
    return found


def _check_span(sensor: Sensor, values: NDArray[np.float64], turn: float, where: str) -> None:
    turns = float(np.ptp(values)) / turn if len(values) else 0.0
    if turns > LARGEST_SPAN:
        what = (
            f"the readings of sensor {sensor.name!r} span {turns:.3g} turns, but "
            "recording.angles is for readings within one turn"
        )
        hint = "leave it out of recording.angles, or leave cells of placeholders empty"
        raise InputError(what, where=where, hint=hint)


def _check_steps(sensor: Sensor, continued: NDArray[np.float64], turn: float, where: str) -> None:
    steps = np.abs(np.diff(continued))
    if len(steps) and float((steps > LONG_STEP * turn).mean()) > MOST_LONG:
        what = (
            f"the angle of sensor {sensor.name!r} moves by nearly half a turn or more between "
            "readings, so its turns cannot be counted"
        )
        hint = "record it more often, or record its rate instead"
        raise InputError(what, where=where, hint=hint)


def _stated_start(system: System, sensor: Sensor) -> float | None:
    """Return the start of the field that a sensor reads; None if it is not known beforehand."""
    start = system.config.start.get(sensor.reads)
    if system.config.spin_up or not isinstance(start, int | float):
        return None
    return float(start)
