"""Reader of CSV recordings: columns ``time``, optionally ``episode``, inputs and sensors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError, nearest
from dashred.core.units import TIME
from dashred.data.checks import check_input, checked_recording, fewest_samples
from dashred.data.episodes import Episode, EpisodeRows, Episodes, split_into_episodes
from dashred.data.io.columns import Columns
from dashred.data.io.csv_table import read_table, separator_hint
from dashred.data.io.sensors_table import read_sensors
from dashred.data.io.stated_units import StatedUnits
from dashred.data.sensors import RESERVED, Sensor, SystemDescription, observable_names
from dashred.physics.backends.input_signals import InputSignals


def read_csv(path: str, sensors_table: str | None, system: SystemDescription) -> Episodes:
    """Read a recording and its table of sensors.

    An ODE system needs no table: columns named after its fields or derived quantities are the
    sensors.

    Args:
        path: of the recording.
        sensors_table: path of the table of sensors, or None.
        system: that the sensors observe.

    Raises:
        InputError: with the file, line and column of the error.
    """
    places = None if sensors_table is None else read_table(sensors_table)
    return episodes_of_table(read_table(path), places, system)


def episodes_of_table(
    table: Columns, places: Columns | None, system: SystemDescription
) -> Episodes:
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
    times, parts = table.numbers("time"), _episode_rows(table)
    fewest = fewest_samples([part.count for part in parts])

    def episode(stretch: EpisodeRows) -> Episode:
        rows, first = stretch.rows, stretch.rows.start

        def place(row: int, column: str | None) -> str:
            return table.location(first + row, column)

        recording = checked_recording(
            sensors,
            times[rows],
            values[rows],
            path=stretch.location(path),
            place=place,
            fewest=fewest,
        )
        driven = InputSignals(times[rows], {name: found[rows] for name, found in inputs.items()})
        return Episode(stretch.name, replace(recording, inputs=driven, units=stated.units))

    return Episodes(tuple(map(episode, parts)))


def _state_units(
    table: Columns, sensors: list[Sensor], system: SystemDescription, stated: StatedUnits
) -> None:
    """Record the units in the header."""
    for name, column, what in (
        (TIME, "time", "time"),
        *((name, column, f"the input {name}") for name, column in system.inputs.items()),
        *((sensor.reads, sensor.name, f"sensor {sensor.name!r}") for sensor in sensors),
    ):
        stated.state(name, table.units.get(column), table.header_location(column), what)


def _inputs(table: Columns, system: SystemDescription) -> dict[str, NDArray[np.float64]]:
    """Return the columns of the system's inputs, known in every row."""
    found = {}
    for name, column in system.inputs.items():
        if column not in table.columns:
            problem = f"the recording has no column {column!r} for the input {name}"
            raise InputError(problem, where=table.path, hint=nearest(column, table.columns))
        found[column] = table.numbers(column)
        check_input(name, column, found[column], table.location)
    return found


def _check_time_column(table: Columns) -> None:
    if "time" in table.columns:
        return
    hint = separator_hint(table.columns) or f"its columns are {', '.join(table.columns)}"
    raise InputError("the recording has no column 'time'", where=table.path, hint=hint)


def _episode_rows(table: Columns) -> list[EpisodeRows]:
    """Return the rows of every episode; of a table without the column, all of them."""
    if "episode" not in table.columns or not len(table):
        return [EpisodeRows("", slice(0, len(table)))]
    return split_into_episodes(table.texts("episode"), lambda row: table.location(row, "episode"))


def _sensor_columns(table: Columns, system: SystemDescription) -> list[str]:
    others = {*RESERVED, *system.inputs.values()}
    return [column for column in table.columns if column not in others]


def _sensors_by_name(table: Columns, system: SystemDescription) -> list[Sensor]:
    if system.axes:
        axes = ", ".join(axis.name for axis in system.axes)
        problem = f"the positions of the sensors (name, field, {axes}, std) are not given"
        hint = "give the table of sensors with recording.sensors=PATH"
        raise InputError(problem, where=table.path, hint=hint)
    known = observable_names(system)
    for column in _sensor_columns(table, system):
        if column not in known:
            problem = f"column {column!r} is neither a field nor a derived quantity of the system"
            hint = f"{nearest(column, known)}; or give a table with recording.sensors=PATH; or "
            hint += "declare a forcing signal as an input: system.inputs"
            raise InputError(problem, where=table.path, hint=hint)
    return [Sensor(column, reads=column) for column in _sensor_columns(table, system)]


def _matched(
    columns: list[str], sensors: tuple[Sensor, ...], path: str, sensors_table: str
) -> list[Sensor]:
    named = {sensor.name: sensor for sensor in sensors}
    for column in columns:
        if column not in named:
            problem = f"column {column!r} is not in the table of sensors {sensors_table}"
            hint = f"{nearest(column, named)}; or declare a forcing signal in system.inputs"
            raise InputError(problem, where=path, hint=hint)
    for name in named:
        if name not in columns:
            problem = f"sensor {name!r} has no column in the recording {path}"
            raise InputError(problem, where=sensors_table, hint=nearest(name, columns))
    return [named[column] for column in columns]
