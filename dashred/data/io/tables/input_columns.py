"""The inputs of a recording: columns that drive the system."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError, nearest
from dashred.data.checks import check_covered, check_gaps, check_input
from dashred.data.input_action import fill_gaps
from dashred.data.io.stated_units import StatedUnits
from dashred.data.io.tables.columns import Columns
from dashred.data.sensors import SystemDescription
from dashred.physics.backends.input_signals import InputSignals


def input_columns(
    table: Columns, system: SystemDescription, stated: StatedUnits
) -> dict[str, NDArray[np.float64]]:
    """Return the columns of the system's inputs, ``(row,)`` each; NaN where a cell is empty.

    Args:
        table: the recording.
        system: with its inputs.
        stated: units of the system and of the recording.

    Raises:
        InputError: a column does not exist, has an infinite value, or has a unit that does not fit.
    """
    found: dict[str, NDArray[np.float64]] = {}
    for name, column in system.inputs.items():
        if column not in table.columns:
            problem = f"the recording has no column {column!r} for the input {name}"
            raise InputError(problem, where=table.path, hint=nearest(column, table.columns))
        values = table.numbers(column)
        # An empty cell is filled later: inputs and sensors may have different clocks.
        known = np.nan_to_num(values, posinf=np.inf, neginf=-np.inf)
        check_input(name, column, known, table.location)
        unit, where = table.units.get(column), table.header_location(column)
        values = stated.state(name, unit, where, f"the input {name}")(values)
        if column in found and not np.array_equal(found[column], values, equal_nan=True):
            problem = f"two inputs read the column {column!r} in different units"
            raise InputError(problem, where=where, hint="state one unit for both in system.units")
        found[column] = values
    return found


def input_signals(
    times: NDArray[np.float64],
    columns: dict[str, NDArray[np.float64]],
    samples: NDArray[np.float64],
    system: SystemDescription,
    path: str,
) -> InputSignals:
    """Return the inputs of one episode, at the rows in which at least one has a value.

    Args:
        times: of all rows of the episode, ``(row,)``.
        columns: values of every input, ``(row,)`` each; NaN where a cell is empty.
        samples: times of the samples that are used, ``(sample,)``.
        system: tells which inputs hold their values.
        path: location for error messages.

    Raises:
        InputError: an input has no value, is empty for long between the samples, or begins after
            the first of them or ends before the last.
    """
    rows = ~np.all([np.isnan(values) for values in columns.values()], axis=0)
    # A held input may have its last value long before the end.
    rows[-1] |= any(column in system.held_inputs for column in columns)
    filled = {}
    for column, values in columns.items():
        where, hold = f"{path}, column {column!r}", column in system.held_inputs
        if np.isnan(values).all():
            hint = "give a value in at least one row of each episode"
            raise InputError("the input has no values", where=where, hint=hint)
        if not hold:
            check_gaps(times, values, samples, where)
        known = fill_gaps(times, values, hold)
        available = np.flatnonzero(~np.isnan(known))
        check_covered(samples, times[available], where)
        # Before its first and after its last value, outside of the samples, an input stays.
        filled[column] = np.interp(times, times[available], known[available])[rows]
    return InputSignals(times[rows], filled)
