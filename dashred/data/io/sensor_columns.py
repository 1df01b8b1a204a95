"""Which columns of a recording are sensors, and which are not read."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Mapping, Sequence

from dashred.core.errors import InputError, nearest
from dashred.data.io.tables.columns import Columns
from dashred.data.sensors import Sensor, SystemDescription


def split_columns(
    table: Columns, columns: Sequence[str], sensors: Collection[str]
) -> tuple[list[str], list[str]]:
    """Split columns into those of sensors and those that are not read.

    A column with nearly the name of a sensor without a column may be misspelt, and is an error.

    Args:
        table: the recording.
        columns: all columns besides times, episodes and inputs.
        sensors: names that sensors may have.

    Raises:
        InputError: a column may be misspelt, or no column is a sensor.
    """
    found = [column for column in columns if column in sensors]
    left_out = [column for column in columns if column not in sensors]
    free = [name for name in sensors if name not in found]
    for column in left_out:
        if close := difflib.get_close_matches(column, free, n=1):
            problem = f"column {column!r} is not known: did you mean {close[0]}?"
            hint = f"rename it; or leave it out with recording.ignore=[{column}]"
            raise InputError(problem, where=table.header_location(column), hint=hint)
    if left_out and not found:
        problem = f"no column is a sensor: the columns are {', '.join(left_out)}"
        hint = f"the names that a sensor may have are {', '.join(sensors)}; another name needs a "
        hint += "table of sensors (recording.sensors=PATH), and a forcing signal system.inputs"
        raise InputError(problem, where=table.path, hint=hint)
    return found, left_out


def check_ignored(table: Columns, ignored: Collection[str]) -> None:
    """Check that the recording has the columns that it should be read without.

    Raises:
        InputError: it does not have one of them.
    """
    for column in ignored:
        if column not in table.columns:
            problem = f"recording.ignore: the recording has no column {column!r}"
            raise InputError(problem, where=table.path, hint=nearest(column, table.columns))


def check_no_axes(table: Columns, system: SystemDescription) -> None:
    """Check that the sensors of a system need no positions.

    Raises:
        InputError: the system has axes.
    """
    if system.axes:
        axes = ", ".join(axis.name for axis in system.axes)
        problem = f"the positions of the sensors (name, field, {axes}, std) are not given"
        hint = "give the table of sensors with recording.sensors=PATH; a recording with a row for "
        hint += f"each time and place has columns for {axes} instead: recording.columns="
        hint += f"{{{system.axes[0].name}: COLUMN}}"
        raise InputError(problem, where=table.path, hint=hint)


def check_recorded(
    sensors: Sequence[Sensor],
    columns: Sequence[str],
    table: Columns,
    places: Columns,
    inputs: Mapping[str, str],
) -> None:
    """Check that every sensor of a table has its column in the recording.

    Raises:
        InputError: one has none, or its column is an input.
    """
    driving = {column: name for name, column in inputs.items()}
    for sensor in sensors:
        if sensor.name in driving:
            known = f"column {sensor.name!r} is the input {driving[sensor.name]}"
            hint = "remove its row here: the simulator already gets its readings"
            problem = f"{known}, so it cannot also be a sensor"
            raise InputError(problem, where=places.path, hint=hint)
        if sensor.name not in columns:
            problem = f"sensor {sensor.name!r} has no column in the recording {table.path}"
            raise InputError(problem, where=places.path, hint=nearest(sensor.name, table.columns))
