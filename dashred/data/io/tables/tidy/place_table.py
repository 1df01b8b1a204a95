"""A table with one row for each time and place: columns for the times, the axes and the fields."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.data.io.stated_units import StatedUnits
from dashred.data.io.tables.columns import Columns
from dashred.data.io.tables.tidy.wide_table import (
    EMPTY,
    WideTable,
    distinct_times,
    repeated_row,
    shared_cells,
)
from dashred.data.io.tables.time_column import TimeColumn, read_times
from dashred.data.sensors import Sensor, SystemDescription, check_sensor, observable_names


def has_places(table: Columns, system: SystemDescription) -> bool:
    """Return whether a table has a column for each axis of a system with axes."""
    axes = [axis.name for axis in system.axes]
    return bool(axes) and set(axes) <= set(table.columns)


def by_place(
    table: Columns, time: TimeColumn, stated: StatedUnits, ignored: Collection[str]
) -> tuple[WideTable, list[Sensor]]:
    """Return a table with a row for each time, and a sensor for each field and place.

    A sensor is called after its field and its place: ``u at 0.5``.

    Args:
        table: with columns for the axes, and for some fields or derived quantities.
        time: its column of times.
        stated: units of the system and of the recording.
        ignored: columns that are not read.

    Raises:
        InputError: there are no times or no fields, a place is no number or outside an axis, or a
            field has two readings at one time and place.
    """
    system = stated.system
    if not time.columns:
        hint = "name the column of the times: recording.columns={time: COLUMN}"
        problem = "a table with a row for each place needs times"
        raise InputError(problem, where=table.path, hint=hint)
    read = [n for n in observable_names(system) if n in table.columns and n not in ignored]
    if not read:
        listed = ", ".join(observable_names(system))
        hint = "name the column of the readings: recording.columns={FIELD: COLUMN}"
        problem = f"no column has the name of a field or let ({listed})"
        raise InputError(problem, where=table.path, hint=hint)
    rows = np.arange(len(table))
    firsts, at = distinct_times(table, read_times(table, time, stated).values, rows)
    cells = shared_cells(table, time, system.inputs.values(), rows, firsts, at)
    places, of_row = _places(table, stated)
    sensors, units = [], dict(table.units)
    for number, place in enumerate(places):
        mine = rows[of_row == number]
        _check_once(table, time, mine, at)
        chosen = np.full(len(firsts), EMPTY)
        chosen[at[mine]] = mine
        for field in read:
            name = f"{field} at {', '.join(f'{x:.6g}' for x in place)}"
            sensors.append(Sensor(name, field, place))
            check_sensor(sensors[-1], system, table.location(int(mine[0])))
            cells[name] = (field, chosen)
            if field in table.units:
                units[name] = table.units[field]
    return WideTable(table, tuple(cells), units, cells), sensors


def _places(
    table: Columns, stated: StatedUnits
) -> tuple[list[tuple[float, ...]], NDArray[np.intp]]:
    """Return the places, in the unit of the system, and the place of each row."""
    columns = []
    for axis in stated.system.axes:
        unit, where = table.units.get(axis.name), table.header_location(axis.name)
        values = stated.state(axis.name, unit, where)(table.numbers(axis.name))
        missing = np.flatnonzero(~np.isfinite(values))
        if missing.size:
            where = table.location(int(missing[0]), axis.name)
            hint = "give the place of the reading, or remove this row"
            raise InputError("the place is missing here", where=where, hint=hint)
        columns.append(values)
    found, of_row = np.unique(np.stack(columns, axis=1), axis=0, return_inverse=True)
    return [tuple(place) for place in found.tolist()], of_row.reshape(-1)


def _check_once(
    table: Columns, time: TimeColumn, mine: NDArray[np.intp], at: NDArray[np.intp]
) -> None:
    """Check that a place has one row at each time.

    Raises:
        InputError: it has two.
    """
    again = repeated_row(mine, at[mine])
    if again is None:
        return
    hint = "if the runs of several episodes are told apart by a column: "
    hint += "recording.columns={..., episode: COLUMN}; else keep one of the rows"
    problem = "this place has a second row at this time"
    raise InputError(problem, where=table.location(again, time.last), hint=hint)
