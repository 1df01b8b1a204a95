"""Guess the fields and axes of a system from the positions of its sensors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dashred.core.errors import InputError
from dashred.data.io.tables.columns import Columns
from dashred.data.io.tables.csv_table import Table, is_number
from dashred.data.io.tables.table_layout import split_header
from dashred.data.io.tables.time_column import TimeColumn
from dashred.pipeline.init.guessed_system import GuessedAxis, GuessedSystem
from dashred.pipeline.init.layout import check_names

# Names of columns of coordinates, and beginnings of such names, in any capitalisation.
COORDINATES = ("x", "y", "z", "r")
COORDINATE_WORDS = ("position", "place", "depth", "distance", "height", "radius", "location")
# A coordinate has this many rows for each place: the columns of an ODE rarely repeat a value.
FEWEST_ROWS = 4
SENSOR_COLUMNS = ("name", "field", "std", "unit")
# Grid points of an axis by the number of axes.
POINTS = {1: 64, 2: 32}
# Key in system.spread of the correlation length of the start, so no field can have this name.
LENGTH = "length"


def system_from_sensors(table: Table) -> GuessedSystem:
    """Return a system with axes that contain the positions in a table of sensors.

    Raises:
        InputError: a column is missing or no coordinate, a position is negative, or a name cannot
            stand in an equation.
    """
    for column in ("name", "field"):
        if column not in table.columns:
            hint = "its columns are name, field, one for each coordinate (x, y) and, if known, std"
            what = f"the table of sensors has no column {column!r}"
            raise InputError(what, where=table.path, hint=hint)
    coordinates = tuple(column for column in table.columns if column not in SENSOR_COLUMNS)
    for column in coordinates:
        if not any(is_number(cell) for cell in table.texts(column) if cell):
            hint = f"coordinates are numbers; the other columns may be {', '.join(SENSOR_COLUMNS)}"
            what = f"the column {column!r} is not a coordinate"
            raise InputError(what, where=table.header_location(column), hint=f"{hint}: remove it")
    if len(coordinates) > 2:
        listed = ", ".join(coordinates)
        what = f"{len(coordinates)} coordinates ({listed}) are too many: the limit is 2"
        raise InputError(what, where=table.path)
    if not table.rows:
        raise InputError("the table has no sensors", where=table.path)
    fields = tuple(dict.fromkeys(table.texts("field")))
    check_names((*coordinates, *fields), "name", table.path)
    for read in fields:
        if read in (*coordinates, LENGTH):
            meaning = "a coordinate" if read in coordinates else "a key of system.spread"
            what = f"the field {read!r} has the name of {meaning}"
            hint = f"rename it in the column 'field', for example to {read}_0"
            raise InputError(what, where=table.path, hint=hint)
    return GuessedSystem(
        tuple(_axis(table, name, len(coordinates)) for name in coordinates), fields
    )


def place_columns(table: Columns, time: TimeColumn) -> tuple[str, ...]:
    """Return the columns of coordinates of a table with a row for each time and place; or none.

    They have the name of a coordinate, each place has several rows, and no two rows have the same
    time, place and episode.

    Args:
        table: of a recording.
        time: its column of times.
    """
    named = [name for name in table.columns if name not in time.columns and _is_coordinate(name)]
    named = [name for name in named if all(map(is_number, table.texts(name)))]
    if not named or len(named) > 2 or not time.columns or not len(table):
        return ()
    shared = [name for name in (*time.columns, "episode") if name in table.columns]
    times, places = (
        [*zip(*(table.texts(name) for name in names), strict=True)] for names in (shared, named)
    )
    rows = len(table)
    is_one_each = len(set(zip(times, places, strict=True))) == rows
    repeat = FEWEST_ROWS * len(set(places)) <= rows and len(set(times)) < rows
    return tuple(named) if is_one_each and repeat and len(set(places)) > 1 else ()


def system_from_places(
    guessed: GuessedSystem, table: Columns, axes: Sequence[str]
) -> GuessedSystem:
    """Return a system with axes that contain the places in a recording.

    Args:
        guessed: with its fields.
        table: a recording with a row for each time and place.
        axes: its columns of coordinates.

    Raises:
        InputError: a position is negative, or the name of an axis cannot stand in an equation.
    """
    check_names(axes, "name", table.path)
    return replace(guessed, axes=tuple(_axis(table, name, len(axes)) for name in axes))


def _is_coordinate(column: str) -> bool:
    """Return whether a column has the name of a coordinate."""
    name = split_header(column)[0].strip().lower()
    return name in COORDINATES or name.startswith(COORDINATE_WORDS)


def _axis(table: Columns, name: str, rank: int) -> GuessedAxis:
    """Guess an axis that ends half a mean spacing after the last sensor, with a rounded length."""
    places = table.numbers(name)
    for row, place in enumerate(places.tolist()):
        if not place >= 0:
            what = "a position must be a number of at least 0, because axes begin at 0"
            hint = f"shift the coordinates so that the domain begins at {name} = 0"
            raise InputError(what, where=table.location(row, name), hint=hint)
    distinct = np.unique(places)
    reach = float(distinct[-1])
    spacing = reach / max(1, len(distinct) - 1)
    length = _rounded_up(reach + spacing / 2) if reach else 1.0
    return GuessedAxis(name, length, POINTS[rank])


def _rounded_up(value: float) -> float:
    """Round up to two significant digits."""
    digit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / digit - 1e-9) * digit:.6g}")
