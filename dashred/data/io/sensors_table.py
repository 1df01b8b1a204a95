"""Reader of the table of sensors: a CSV with the columns ``name, field, x[, y], std, unit``."""

from __future__ import annotations

import numpy as np

from dashred.core.errors import InputError, nearest
from dashred.core.stated.noise import StatedNoise, parse_noise
from dashred.data.io.stated_units import StatedUnits
from dashred.data.io.tables.columns import Columns
from dashred.data.sensors import Sensor, SystemDescription, check_names, check_sensor

# Cells of the column std of a sensor whose noise is not known.
UNKNOWN = ("", "nan")
OPTIONAL_COLUMNS = ("std", "unit")


def read_sensors(
    table: Columns, system: SystemDescription, stated: StatedUnits
) -> tuple[Sensor, ...]:
    """Read the sensors of a system, in the order of the table.

    Columns: ``name``; ``field``, a field or derived quantity of the system; one coordinate per
    axis, under the name of the axis, and optionally its width such as ``x_width``, in the same
    unit, for a sensor that averages over a region; optionally ``std`` (:func:`.parse_noise`), empty
    where the noise is unknown, and ``unit`` of the measured quantity.

    Args:
        table: with these columns.
        system: that has these sensors.
        stated: takes note of the units of the axes; positions are converted to the system's.

    Raises:
        InputError: for a missing or unknown column, a repeated name, a sensor that does not fit
            the system, or a unit of an axis that cannot be converted.
    """
    axes = [axis.name for axis in system.axes]
    wide = [f"{axis}_width" for axis in axes]
    _check_columns(table, axes)
    if not len(table):
        raise InputError("the table has no sensors", where=table.path)
    names = table.texts("name")
    check_names(names, table.path)
    convert = [
        stated.state(axis, table.units.get(axis), table.header_location(axis)) for axis in axes
    ]
    positions = [change(table.numbers(axis)) for change, axis in zip(convert, axes, strict=True)]
    widths = [
        change(np.nan_to_num(table.numbers(column))) if column in table.columns else None
        for change, column in zip(convert, wide, strict=True)
    ]
    stds = table.texts("std") if "std" in table.columns else [""] * len(names)
    sensors = []
    for row, (name, reads) in enumerate(zip(names, table.texts("field"), strict=True)):
        position = tuple(float(column[row]) for column in positions)
        noise = StatedNoise()
        if stds[row].strip().lower() not in UNKNOWN:
            where = table.location(row, "std")
            noise = parse_noise(stds[row], f"the std of sensor {name!r}", where)
        region = tuple(0.0 if column is None else float(column[row]) for column in widths)
        sensors.append(Sensor(name, reads, position, *noise, widths=region if any(region) else ()))
        check_sensor(sensors[-1], system, table.location(row))
    return tuple(sensors)


def _check_columns(table: Columns, axes: list[str]) -> None:
    needed = ("name", "field", *axes)
    for column in needed:
        if column not in table.columns:
            problem = f"the table of sensors has no column {column!r}"
            hint = f"its columns must be {', '.join(needed)} and, if known, std and unit"
            raise InputError(problem, where=table.path, hint=hint)
    for column in table.columns:
        known = (*needed, *OPTIONAL_COLUMNS, *(f"{axis}_width" for axis in axes))
        if column not in known:
            problem = f"unknown column {column!r} in the table of sensors"
            hint = nearest(column, known)
            raise InputError(problem, where=table.path, hint=hint)
