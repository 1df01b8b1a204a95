"""A table with one row for each reading, seen as one with a column for each sensor."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.core.stated.column_names import SENSOR, VALUE
from dashred.data.io.stated_units import StatedUnits
from dashred.data.io.tables.columns import Columns
from dashred.data.io.tables.dates import CLOCK
from dashred.data.io.tables.table_header import read_header
from dashred.data.io.tables.table_layout import TableLayout
from dashred.data.io.tables.tidy.wide_table import (
    EMPTY,
    WideTable,
    distinct_times,
    repeated_row,
    shared_cells,
)
from dashred.data.io.tables.time_column import TimeColumn, read_times


def is_long(table: Columns, others: Sequence[str]) -> bool:
    """Return whether a table has the columns ``sensor`` and ``value``.

    Args:
        table: of a recording, with the names of the configuration.
        others: names of fields, lets and sensors: a column with such a name is its own sensor.
    """
    return {SENSOR, VALUE} <= set(table.columns) and not {SENSOR, VALUE} & set(others)


def widened(
    table: Columns, time: TimeColumn, stated: StatedUnits, layout: TableLayout
) -> WideTable:
    """Return a long table as one with a row for each time of each episode.

    Rows with an empty value are no readings.

    Args:
        table: with the columns ``sensor`` and ``value``.
        time: its column of times.
        stated: units of the system and of the recording.
        layout: with names for sensors, by their name in the file.

    Raises:
        InputError: there are no times, a sensor has no name, that of another column, or two
            readings at one time, or an input has two values at one time.
    """
    if not time.columns:
        hint = "name the column of the times: recording.columns={time: COLUMN}"
        problem = "a table with a row for each reading needs times"
        raise InputError(problem, where=table.path, hint=hint)
    names, values = table.texts(SENSOR), table.texts(VALUE)
    read = np.flatnonzero([value != "" for value in values])
    if nameless := next((row for row in read.tolist() if not names[row]), None):
        raise InputError("the sensor has no name here", where=table.location(nameless, SENSOR))
    times = read_times(table, time, stated).values
    _check_clock(table, time, names)
    firsts, at = distinct_times(table, times, read)
    name_of = np.array(names)[read]
    plain = [*dict.fromkeys(name_of.tolist())]
    headers, units = _headers(table, plain, layout)
    cells = shared_cells(table, time, stated.system.inputs.values(), read, firsts, at)
    for header, sensor in zip(headers, plain, strict=True):
        rows = np.full(len(firsts), EMPTY)
        if header in cells:
            problem = f"the sensor {sensor!r} has the name of another column"
            hint = f"give it a name of its own: recording.columns={{..., NAME: {sensor}}}"
            raise InputError(problem, where=table.header_location(SENSOR), hint=hint)
        own = name_of == sensor
        _check_once(table, sensor, read[own], at[own])
        rows[at[own]] = read[own]
        cells[header] = (VALUE, rows)
    return WideTable(table, tuple(cells), units, cells)


def _headers(
    table: Columns, plain: Sequence[str], layout: TableLayout
) -> tuple[tuple[str, ...], dict[str, str]]:
    """Return the names of the sensors, and the units of all columns."""
    own = {name: text for name, text in layout.headers.items() if name not in table.columns}
    where = table.header_location(SENSOR)
    renamed = TableLayout(headers=own).rename(plain, where)
    headers, units = read_header(renamed, where, layout.used)
    if common := table.units.get(VALUE):
        units = {**dict.fromkeys(headers, common), **units}
    return headers, {**table.units, **units}


def _check_once(table: Columns, sensor: str, rows: NDArray[np.intp], at: NDArray[np.intp]) -> None:
    """Check that a sensor has one reading at each time.

    Raises:
        InputError: it has two.
    """
    again = repeated_row(rows, at)
    if again is None:
        return
    problem = f"the sensor {sensor!r} has a second reading at this time"
    hint = "keep one of the readings, or their mean"
    if "episode" in table.columns:
        problem += f" of episode {table.texts('episode')[again]!r}"
    else:
        hint += "; if a column tells the runs of several episodes apart: "
        hint += "recording.columns={..., episode: COLUMN}"
    raise InputError(problem, where=table.location(again, SENSOR), hint=hint)


def _check_clock(table: Columns, time: TimeColumn, names: Sequence[str]) -> None:
    """Check that times of day are not given for one sensor after the other.

    Raises:
        InputError: they are: midnight could not be told from the beginning of the next sensor.
    """
    changes = sum(a != b for a, b in pairwise(names))
    in_turn = 0 < changes == len(set(names)) - 1
    if in_turn and CLOCK.fullmatch(next(iter(table.texts(time.last)), "")):
        problem = "times of day need all readings of one time together, not sensor after sensor"
        hint = "write dates, 2024-05-17 12:30:00, or sort the rows by time"
        raise InputError(problem, where=table.header_location(time.last), hint=hint)
