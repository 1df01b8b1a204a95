"""Guess the fields and axes of a system from a table of sensors in space."""

from __future__ import annotations

import math

import numpy as np

from dashred.core.errors import InputError
from dashred.data.io.tables.csv_table import Table, is_number
from dashred.pipeline.init.guessed_system import GuessedAxis, GuessedSystem
from dashred.pipeline.init.layout import check_names

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


def _axis(table: Table, name: str, rank: int) -> GuessedAxis:
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
