"""The table of sensors: a CSV with the columns ``name, field, x[, y], std``."""

from __future__ import annotations

import math

from dashred.errors import InputError, nearest
from dashred.sensing.sensors import Described, Sensor, check_names, check_sensor
from dashred.sensing.tables import Table, read_table


def read_sensors(path: str, system: Described) -> tuple[Sensor, ...]:
    """Read the sensors of a system, in the order of the table.

    Columns: ``name``, ``field`` (a field or let of the system), one coordinate for each axis under
    the axis' own name, and optionally ``std``, empty where the noise is not known.

    Raises:
        InputError: for a missing or unknown column, a repeated name, or a sensor that the system
            cannot have.
    """
    table = read_table(path)
    axes = [axis.name for axis in system.axes]
    _check_columns(table, axes)
    if not table.rows:
        raise InputError("the table names no sensor", where=path)
    names = table.texts("name")
    check_names(names, path)
    positions = [table.numbers(axis) for axis in axes]
    stds = table.numbers("std") if "std" in table.columns else [math.nan] * len(names)
    sensors = []
    for row, (name, reads) in enumerate(zip(names, table.texts("field"), strict=True)):
        position = tuple(float(column[row]) for column in positions)
        std = None if math.isnan(stds[row]) else float(stds[row])
        sensors.append(Sensor(name, reads, position, std))
        check_sensor(sensors[-1], system, table.place(row))
    return tuple(sensors)


def _check_columns(table: Table, axes: list[str]) -> None:
    needed = ("name", "field", *axes)
    for column in needed:
        if column not in table.columns:
            problem = f"the table of sensors has no column {column!r}"
            hint = f"its columns must be {', '.join(needed)} and, if known, std"
            raise InputError(problem, where=table.path, hint=hint)
    for column in table.columns:
        if column not in (*needed, "std"):
            problem = f"unknown column {column!r} in the table of sensors"
            hint = nearest(column, (*needed, "std"))
            raise InputError(problem, where=table.path, hint=hint)
