"""Guess the names of the columns of a table whose own names are missing or cannot be used."""

from __future__ import annotations

import keyword
import re
import unicodedata
from collections.abc import Collection, Sequence

import numpy as np

from dashred.config.schema.types import NAME
from dashred.core.errors import InputError
from dashred.core.stated.column_names import SENSOR, VALUE
from dashred.data.io.tables.columns import Columns
from dashred.data.io.tables.csv_table import Table, is_number
from dashred.data.io.tables.recording_table import (
    count_unnamed,
    read_recording_table,
    unclear_groups,
)
from dashred.data.io.tables.table_layout import TableLayout, split_header
from dashred.data.io.tables.time_column import (
    TimeColumn,
    date_and_clock,
    episode_column,
    find_time_column,
    likely_times,
    named_times,
)
from dashred.data.sensors import RESERVED
from dashred.physics.expressions.parser import RESERVED as LANGUAGE
from dashred.pipeline.init.long import long_columns

# Time from row to row of a table without times, until the user gives it.
STEP = 1.0


def read_with_guessed_names(
    path: str, is_ode: bool, ignored: Collection[str] = ()
) -> tuple[Table, TableLayout]:
    """Read a recording, and return it with names for its columns.

    A table without a header gets the names time, u1, u2, and so on. A column that may have the
    times is named time. If the columns are the fields of an ODE, names that cannot be used in an
    equation are changed: ``wind speed`` to ``wind_speed``.

    Args:
        path: of the recording.
        is_ode: whether the columns are the fields of an ODE.
        ignored: columns that are left out, by their name in the file.

    Raises:
        InputError: the table is invalid.
    """
    if count := count_unnamed(path):
        names = tuple(f"u{i}" for i in range(count))
        table = read_recording_table(path, TableLayout(names))
        found = likely_times(table)
        time = TimeColumn(() if found is None else (found,))
        if (long := long_columns(table, time)) is not None:
            own = {"time": time.last, **long}
            numbers = {name: str(names.index(column) + 1) for name, column in own.items()}
            sensors = _names_of_sensors(table, long[SENSOR], is_ode)
            return table.renamed(own), TableLayout(headers={**numbers, **sensors})
        table = table.renamed({} if found is None else {"time": found})
        return table, TableLayout(table.columns, step=None if found else STEP)
    groups = unclear_groups(path)
    headers = {"episode": groups[0]} if groups else {}
    table = read_recording_table(path, TableLayout(headers=headers, ignored=ignored))
    likely = None if named_times(table, ignored) else likely_times(table, ignored)
    if likely is None:
        time = find_time_column(table, STEP, ignored)
    elif (both := date_and_clock(table)) is not None:
        headers |= zip(("date", "time"), both, strict=True)
        time = TimeColumn(both)
    else:
        headers["time"], time = likely, TimeColumn((likely,))
    times = time.columns
    if (long := long_columns(table, time)) is not None:
        headers |= long
        sensors = _names_of_sensors(table, long[SENSOR], is_ode)
        return table.renamed(headers), TableLayout(headers={**headers, **sensors})
    if "episode" not in table.columns and (runs := _runs(table, time)) is not None:
        headers["episode"], times = runs, (*times, runs)
    if is_ode:
        taken = {*RESERVED, *times, *table.columns}
        for column in table.columns:
            if column not in (*RESERVED, *times) and has_numbers(table, column):
                name = _usable(column, taken)
                if name != column:
                    headers[name] = column
                    taken.add(name)
    layout = TableLayout(headers=headers, step=None if time.columns else STEP)
    return table.renamed(headers), layout


def _names_of_sensors(table: Table, column: str, is_ode: bool) -> dict[str, str]:
    """Return names that can stand in an equation for the sensors of a long table."""
    labels = [*dict.fromkeys(table.texts(column))] if is_ode else []
    headers: dict[str, str] = {}
    meant = (*RESERVED, SENSOR, VALUE)
    taken = {*meant, *labels}
    for label in labels:
        plain = split_header(label)[0]
        name = _usable(f"{plain} 1" if plain in meant else plain, taken)
        if name != plain:
            headers[name] = label
            taken.add(name)
    return headers


def _runs(table: Table, time: TimeColumn) -> str | None:
    """Return the column that tells several runs apart, if their times are numbers."""
    cells = table.texts(time.last) if time.columns else []
    if not all(cell and is_number(cell) for cell in cells):
        return None
    return episode_column(table, np.array([float(cell) for cell in cells]), time)


def has_numbers(table: Columns, column: str) -> bool:
    """Return whether the first value of a column is a number, and not a remark for example."""
    first = next((cell for cell in table.texts(column) if cell), None)
    return first is not None and is_number(first)


def is_usable(name: str) -> bool:
    """Return whether a name can stand in an equation."""
    return bool(NAME.match(name)) and not keyword.iskeyword(name) and name not in LANGUAGE


def _usable(column: str, taken: Collection[str]) -> str:
    """Return the name of a column, changed if it cannot stand in an equation."""
    if is_usable(column):
        return column
    plain = unicodedata.normalize("NFKD", column).encode("ascii", "ignore").decode()
    name = re.sub(r"\W+", "_", plain).strip("_") or "u"
    name = name if name[0].isalpha() else f"u_{name}"
    candidates = [name, *(f"{name}_{i}" for i in range(len(taken) + 1))]
    return next(name for name in candidates if is_usable(name) and name not in taken)


def check_names(names: Sequence[str], kind: str, where: str) -> None:
    """Check that names can stand in an equation.

    Raises:
        InputError: one cannot.
    """
    for name in names:
        if is_usable(name):
            continue
        what = f"the {kind} {name!r} cannot be a name in an equation"
        hint = "use letters, digits and _, with a letter first; a unit goes in [ ]: 'theta [rad]'"
        if NAME.match(name):
            what = f"the {kind} {name!r} has another meaning in an equation"
            hint = f"rename it in the header, for example to {name}_0"
        raise InputError(what, where=where, hint=hint)
