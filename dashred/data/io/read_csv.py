"""Reader of recordings in tables: columns ``time``, optionally ``episode``, inputs and sensors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.core.stated.column_names import SENSOR, VALUE
from dashred.data.checks import checked_recording, fewest_samples
from dashred.data.clocks.record_part import part_of
from dashred.data.clocks.rounded_times import without_rounding
from dashred.data.episodes import Episode, EpisodeRows, Episodes, runs_of_clock, split_into_episodes
from dashred.data.io.sensor_columns import (
    check_ignored,
    check_no_axes,
    check_recorded,
    split_columns,
)
from dashred.data.io.sensor_units import convert_sensors
from dashred.data.io.sensors_table import read_sensors
from dashred.data.io.stated_units import StatedUnits
from dashred.data.io.tables.columns import Columns
from dashred.data.io.tables.csv_table import read_table
from dashred.data.io.tables.input_columns import input_columns, input_signals
from dashred.data.io.tables.recording_table import read_recording_table
from dashred.data.io.tables.table_layout import TableLayout
from dashred.data.io.tables.tidy.long_table import is_long, widened
from dashred.data.io.tables.tidy.place_table import by_place, has_places
from dashred.data.io.tables.time_column import (
    TimeColumn,
    changing_label,
    episode_column,
    find_time_column,
    read_times,
)
from dashred.data.recording import Recording
from dashred.data.sensors import RESERVED, Sensor, SystemDescription, observable_names


def read_csv(
    path: str, sensors_table: str | None, system: SystemDescription, layout: TableLayout
) -> Episodes:
    """Read a recording and its table of sensors.

    An ODE system needs no table: columns named after its fields or derived quantities are the
    sensors. A system with axes needs none if the recording has a row for each time and place.

    Args:
        path: of the recording.
        sensors_table: path of the table of sensors, or None.
        system: that the sensors observe.
        layout: what is known of the table of the recording.

    Raises:
        InputError: with the file, line and column of the error.
    """
    places = None if sensors_table is None else read_table(sensors_table)
    return episodes_of_file(path, places, system, layout)


def episodes_of_file(
    path: str, places: Columns | None, system: SystemDescription, layout: TableLayout
) -> Episodes:
    """Read a recording with a table of sensors that is read already.

    Args:
        path: of the recording.
        places: the table that says what the columns are; None says that they are fields or lets.
        system: that was recorded.
        layout: what is known of the table of the recording.

    Raises:
        InputError: as :func:`read_csv`.
    """
    if places is None:
        read = [*observable_names(system), *(axis.name for axis in system.axes)]
    else:
        read = places.texts("name") if "name" in places.columns else []
    used = {*layout.ignored, *system.inputs.values(), *read}
    table = read_recording_table(path, replace(layout, used=used))
    return episodes_of_table(table, places, system, layout)


def episodes_of_table(
    table: Columns,
    places: Columns | None,
    system: SystemDescription,
    layout: TableLayout,
) -> Episodes:
    """Read a recording from a table of times, optionally ``episode``, and one column a sensor.

    Args:
        table: the recording.
        places: the table that says what the columns are; None says that they are fields or lets.
        system: that was recorded.
        layout: what is known of the table.

    Raises:
        InputError: as :func:`read_csv`.
    """
    path, ignored = table.path, layout.ignored
    time = find_time_column(table, layout.step, ignored)
    stated = StatedUnits(system)
    check_ignored(table, ignored)
    named = [] if places is None or "name" not in places.columns else places.texts("name")
    source, placed, read = table, None, {SENSOR, VALUE}
    if is_long(table, (*observable_names(system), *named)):
        table = widened(table, time, stated, layout)
    elif places is None and has_places(table, system):
        table, placed = by_place(table, time, stated, ignored)
        read = {axis.name for axis in system.axes} | {sensor.reads for sensor in placed}
    unread = [name for name in source.columns if name not in {*table.columns, *read}]
    clock, parts = read_times(table, time, stated), _episode_rows(table)
    times = clock.values
    if len(parts) == 1:
        _check_one_run(table, times, time)
        parts = runs_of_clock(times) or parts
    is_rounded = False
    if time.columns and clock.of_date is None and (times[1:] == times[:-1]).any():
        rows = [part.rows for part in parts]
        times, is_rounded = without_rounding(times, table.texts(time.last), rows)
    inputs = input_columns(table, system, stated)
    others = (*RESERVED, *time.columns, *system.inputs.values(), *ignored)
    columns = [column for column in table.columns if column not in others]
    if placed is not None:
        sensors = placed
    elif places is None:
        check_no_axes(table, system)
        sensors = [Sensor(name, reads=name) for name in observable_names(system)]
    else:
        sensors = [*read_sensors(places, system, stated)]
    columns, left_out = split_columns(table, columns, [sensor.name for sensor in sensors])
    left_out += [name for name in unread if name not in ignored]
    if places is not None:
        check_recorded(sensors, columns, table, places, system.inputs)
    by_name = {sensor.name: sensor for sensor in sensors}
    sensors = [by_name[column] for column in columns]
    sensors, conversions = convert_sensors(sensors, table, places, stated)
    values = np.empty((len(table), len(sensors)))
    for index, (sensor, convert) in enumerate(zip(sensors, conversions, strict=True)):
        values[:, index] = convert(table.numbers(sensor.name))
    fewest = fewest_samples([part.count for part in parts])

    def episode(stretch: EpisodeRows) -> Episode:
        rows, first = stretch.rows, stretch.rows.start

        def place(row: int, column: str | None) -> str:
            return table.location(first + row, time.last if column == "time" else column)

        recording = checked_recording(
            sensors,
            times[rows],
            values[rows],
            path=stretch.location(path),
            place=place,
            fewest=fewest,
        )
        recording = replace(recording, units=stated.units)
        if inputs:
            recording = _with_readings(recording)
            if len(recording.times) < fewest:
                problem = f"{len(recording.times)} rows with readings are too few: at least "
                raise InputError(f"{problem}{fewest} are needed", where=stretch.location(path))
        return Episode(stretch.name, recording)

    whole = Episodes(tuple(map(episode, parts)), tuple(left_out), is_rounded)
    chosen = part_of(whole, layout.part, path, clock.of_date)
    if not inputs:
        return chosen
    stretches = {stretch.name: stretch for stretch in parts}

    def driven(episode: Episode) -> Episode:
        stretch = stretches[episode.name]
        own = {column: found[stretch.rows] for column, found in inputs.items()}
        where, samples = stretch.location(path), episode.recording
        signals = input_signals(times[stretch.rows], own, samples.times, system, where)
        return replace(episode, recording=replace(samples, inputs=signals))

    return replace(chosen, episodes=tuple(map(driven, chosen.episodes)))


def _with_readings(recording: Recording) -> Recording:
    """Return the samples with at least one reading: a row may contain inputs only."""
    seen = ~np.isnan(recording.values).all(axis=1)
    return replace(recording, times=recording.times[seen], values=recording.values[seen])


def _episode_rows(table: Columns) -> list[EpisodeRows]:
    """Return the rows of every episode; of a table without the column, all of them."""
    if "episode" not in table.columns or not len(table):
        return [EpisodeRows("", slice(0, len(table)))]
    return split_into_episodes(table.texts("episode"), lambda row: table.location(row, "episode"))


def _check_one_run(table: Columns, times: NDArray[np.float64], time: TimeColumn) -> None:
    """Check that the times do not start again, or repeat, where another column changes.

    Raises:
        InputError: they do.
    """
    column, found = episode_column(table, times, time), np.flatnonzero(times[1:] < times[:-1])
    says = "start again"
    if column is None:
        found, says = np.flatnonzero(times[1:] <= times[:-1]), "repeat or start again"
        column = changing_label(table, found)
    if column is None:
        return
    restart = int(found[0]) + 1
    problem = f"the times {says}, where {column!r} changes"
    hint = f"if these are several episodes: recording.columns={{episode: {column}}}; if it names "
    hint += f"the sensor of each row: recording.columns={{sensor: {column}, value: COLUMN}}"
    raise InputError(problem, where=table.location(restart, time.last), hint=hint)
