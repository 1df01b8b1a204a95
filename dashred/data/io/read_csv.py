"""Recordings in CSV: ``time``, optionally ``episode``, and one column for each sensor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError, nearest
from dashred.core.units import TIME
from dashred.data.checks import check_input, checked_recording
from dashred.data.episodes import Episode, Episodes, Stretch, stretches
from dashred.data.io.columns import Columns
from dashred.data.io.csv_table import read_table, separated_otherwise
from dashred.data.io.sensors_table import read_sensors
from dashred.data.io.stated_units import StatedUnits
from dashred.data.sensors import RESERVED, Described, Sensor, readable
from dashred.physics.backends.input_signals import Measured


def read_csv(path: str, sensors_table: str | None, system: Described) -> Episodes:
    """Read a recording and the table that says what its columns are.

    An ODE system needs no table: columns named like its fields or lets are the sensors.

    Raises:
        InputError: saying in which line and column of which file the fault is.
    """
    places = None if sensors_table is None else read_table(sensors_table)
    return episodes_of_table(read_table(path), places, system)


def episodes_of_table(table: Columns, places: Columns | None, system: Described) -> Episodes:
    """Read a recording from a table of ``time``, optionally ``episode``, and one column a sensor.

    Args:
        table: the recording.
        places: the table that says what the columns are; None says that they are fields or lets.
        system: that was recorded.

    Raises:
        InputError: as :func:`read_csv`.
    """
    path = table.path
    _check_time_column(table)
    inputs, stated = _inputs(table, system), StatedUnits(system)
    if places is None:
        sensors = _sensors_by_name(table, system)
    else:
        named = read_sensors(places, system, stated)
        sensors = _matched(_sensor_columns(table, system), named, path, places.path)
    _state_units(table, sensors, system, stated)
    values = np.empty((len(table), len(sensors)))
    for index, sensor in enumerate(sensors):
        values[:, index] = table.numbers(sensor.name)
    times = table.numbers("time")

    def episode(stretch: Stretch) -> Episode:
        rows, first = stretch.rows, stretch.rows.start

        def place(row: int, column: str | None) -> str:
            return table.place(first + row, column)

        recording = checked_recording(
            sensors, times[rows], values[rows], path=stretch.within(path), place=place
        )
        driven = Measured(times[rows], {name: found[rows] for name, found in inputs.items()})
        return Episode(stretch.name, replace(recording, inputs=driven, units=stated.units))

    return Episodes(tuple(map(episode, _stretches(table))))


def _state_units(
    table: Columns, sensors: list[Sensor], system: Described, stated: StatedUnits
) -> None:
    """Take note of the units in the header."""
    for name, column, what in (
        (TIME, "time", "time"),
        *((name, column, f"the input {name}") for name, column in system.inputs.items()),
        *((sensor.reads, sensor.name, f"sensor {sensor.name!r}") for sensor in sensors),
    ):
        stated.state(name, table.units.get(column), table.header_place(column), what)


def _inputs(table: Columns, system: Described) -> dict[str, NDArray[np.float64]]:
    """Return the columns of the system's inputs, known in every row."""
    found = {}
    for name, column in system.inputs.items():
        if column not in table.columns:
            problem = f"the recording has no column {column!r} for the input {name}"
            raise InputError(problem, where=table.path, hint=nearest(column, table.columns))
        found[column] = table.numbers(column)
        check_input(name, column, found[column], table.place)
    return found


def _check_time_column(table: Columns) -> None:
    if "time" in table.columns:
        return
    hint = separated_otherwise(table.columns) or f"its columns are {', '.join(table.columns)}"
    raise InputError("the recording has no column 'time'", where=table.path, hint=hint)


def _stretches(table: Columns) -> list[Stretch]:
    """Return the rows of every episode; of a table without the column, all of them."""
    if "episode" not in table.columns or not len(table):
        return [Stretch("", slice(0, len(table)))]
    return stretches(table.texts("episode"), lambda row: table.place(row, "episode"))


def _sensor_columns(table: Columns, system: Described) -> list[str]:
    others = {*RESERVED, *system.inputs.values()}
    return [column for column in table.columns if column not in others]


def _sensors_by_name(table: Columns, system: Described) -> list[Sensor]:
    if system.axes:
        axes = ", ".join(axis.name for axis in system.axes)
        problem = f"the places of the sensors (name, field, {axes}, std) are not given"
        raise InputError(problem, where=table.path, hint="recording.sensors=PATH names their table")
    known = readable(system)
    for column in _sensor_columns(table, system):
        if column not in known:
            problem = f"column {column!r} is neither a field nor a let of the system"
            hint = f"{nearest(column, known)}; or name a table with recording.sensors=PATH; what "
            hint += "drives the system is an input: system.inputs"
            raise InputError(problem, where=table.path, hint=hint)
    return [Sensor(column, reads=column) for column in _sensor_columns(table, system)]


def _matched(
    columns: list[str], sensors: tuple[Sensor, ...], path: str, sensors_table: str
) -> list[Sensor]:
    named = {sensor.name: sensor for sensor in sensors}
    for column in columns:
        if column not in named:
            problem = f"column {column!r} is not in the table of sensors {sensors_table}"
            hint = f"{nearest(column, named)}; what drives the system is an input: system.inputs"
            raise InputError(problem, where=path, hint=hint)
    for name in named:
        if name not in columns:
            problem = f"sensor {name!r} has no column in the recording {path}"
            raise InputError(problem, where=sensors_table, hint=nearest(name, columns))
    return [named[column] for column in columns]
