"""Reader of the table of sensors: a CSV with the columns ``name, field, x[, y], std, unit``."""

from __future__ import annotations

import math

import numpy as np

from dashred.core.errors import InputError, nearest
from dashred.core.units import check_unit
from dashred.data.io.columns import Columns
from dashred.data.io.stated_units import StatedUnits
from dashred.data.sensors import Sensor, SystemDescription, check_names, check_sensor

OPTIONAL_COLUMNS = ("std", "unit")


def read_sensors(
    table: Columns, system: SystemDescription, stated: StatedUnits
) -> tuple[Sensor, ...]:
    """Read the sensors of a system, in the order of the table.

    Columns: ``name``; ``field``, a field or derived quantity of the system; one coordinate per
    axis, under the name of the axis; optionally ``std``, empty where the noise is unknown, and
    ``unit`` of the measured quantity.

    Args:
        table: with these columns.
        system: that has these sensors.
        stated: takes note of the units in the table.

    Raises:
        InputError: for a missing or unknown column, a repeated name, a sensor that does not fit
            the system, or a unit that differs from the configuration.
    """
    axes = [axis.name for axis in system.axes]
    _check_columns(table, axes)
    if not len(table):
        raise InputError("the table has no sensors", where=table.path)
    names = table.texts("name")
    check_names(names, table.path)
    positions = [table.numbers(axis) for axis in axes]
    stds = table.numbers("std") if "std" in table.columns else np.full(len(names), np.nan)
    sensors = []
    for row, (name, reads) in enumerate(zip(names, table.texts("field"), strict=True)):
        position = tuple(float(column[row]) for column in positions)
        std = None if math.isnan(stds[row]) else float(stds[row])
        sensors.append(Sensor(name, reads, position, std))
        check_sensor(sensors[-1], system, table.location(row))
    _state_units(table, sensors, axes, stated)
    return tuple(sensors)


def _state_units(
    table: Columns, sensors: list[Sensor], axes: list[str], stated: StatedUnits
) -> None:
    for axis in axes:
        stated.state(axis, table.units.get(axis), table.header_location(axis))
    for row, sensor in enumerate(sensors):
        what = f"sensor {sensor.name!r}"
        if "unit" in table.columns and (unit := table.texts("unit")[row]):
            where = table.location(row, "unit")
            stated.state(sensor.reads, check_unit(unit, what, where), where, what)
        where = table.header_location("std")
        stated.state(sensor.reads, table.units.get("std"), where, f"the std of {what}")


def _check_columns(table: Columns, axes: list[str]) -> None:
    needed = ("name", "field", *axes)
    for column in needed:
        if column not in table.columns:
            problem = f"the table of sensors has no column {column!r}"
            hint = f"its columns must be {', '.join(needed)} and, if known, std and unit"
            raise InputError(problem, where=table.path, hint=hint)
    for column in table.columns:
        if column not in (*needed, *OPTIONAL_COLUMNS):
            problem = f"unknown column {column!r} in the table of sensors"
            hint = nearest(column, (*needed, *OPTIONAL_COLUMNS))
            raise InputError(problem, where=table.path, hint=hint)
