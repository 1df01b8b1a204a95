"""The times of a recording: the column that has them, as numbers or as dates."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.core.units import TIME
from dashred.data.checks import MIN_EPISODE_SAMPLES
from dashred.data.io.stated_units import StatedUnits
from dashred.data.io.tables.columns import Columns
from dashred.data.io.tables.csv_table import is_number
from dashred.data.io.tables.dates import CLOCK, is_date, read_dates, seconds_until
from dashred.data.io.tables.table_layout import ELAPSED, TIMES, split_header, unit_of_times

SECONDS = {
    "us": 1e-6,
    "ms": 1e-3,
    **dict.fromkeys(("s", "sec", "second", "seconds"), 1.0),
    **dict.fromkeys(("min", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hr", "hour", "hours"), 3600.0),
    **dict.fromkeys(("d", "day", "days"), 86400.0),
    **dict.fromkeys(("week", "weeks"), 7 * 86400.0),
    **dict.fromkeys(("yr", "year", "years"), 365.25 * 86400.0),
}
# Cells that are looked at to guess which column has the times.
FEW = 20


@dataclass(frozen=True)
class TimeColumn:
    """The columns of a table that have its times.

    Attributes:
        columns: the column of the times; or the column of the date, then that of the time of day;
            none if the rows have a constant step.
        step: time from row to row, without a column.
    """

    columns: tuple[str, ...]
    step: float = 1.0

    @property
    def last(self) -> str:
        """The column that error messages name."""
        return self.columns[-1] if self.columns else "time"


@dataclass(frozen=True)
class Times:
    """The times of a recording.

    Attributes:
        values: of all rows, in the unit of time of the system, ``(row,)``.
        of_date: returns the time of a date, NaN if it is none; None if the times are numbers.
    """

    values: NDArray[np.float64]
    of_date: Callable[[str], float] | None = None


def find_time_column(
    table: Columns, step: float | None = None, ignored: Collection[str] = ()
) -> TimeColumn:
    """Find the column ``time``, or another one with a name for times, such as ``Timestamp``.

    Of the columns ``Date`` and ``Time``, both are used if the second has times of day.

    Args:
        table: the recording.
        step: time from row to row, if it is known, for a table in which no column may have times.
        ignored: columns that have none, although their cells may look so.

    Raises:
        InputError: there is no such column and no step, or there are several columns.
    """
    candidates = named_times(table, ignored)
    times, dates = ([c for c in candidates if c.lower() == name] for name in ("time", "date"))
    if len(times) == len(dates) == 1 and _has_clock(table, times[0]):
        return TimeColumn((dates[0], times[0]))
    if "time" in candidates:
        return TimeColumn(("time",))
    if len(candidates) == 1:
        return TimeColumn((candidates[0],))
    if candidates:
        problem = f"which column has the times: {', '.join(candidates)}?"
        hint = f"name it: recording.columns={{time: {candidates[0]}}}"
        raise InputError(problem, where=table.path, hint=hint)
    likely = likely_times(table, ignored)
    # A column that may have the times is not passed over.
    if step is not None and likely is None:
        return TimeColumn((), step)
    named = likely or "COLUMN"
    hint = f"its columns are {', '.join(table.columns[:12])}. If one has the times, name it: "
    hint += f"recording.columns={{time: {named}}}; else give the step from row to row: "
    hint += "recording.every=STEP"
    raise InputError("the recording has no column 'time'", where=table.path, hint=hint)


def has_dates(table: Columns, column: TimeColumn) -> bool:
    """Return whether the times are dates or times of day."""
    first = next((cell for cell in _joined(table, column) if cell), "") if column.columns else ""
    return is_date(first)


def named_times(table: Columns, ignored: Collection[str] = ()) -> list[str]:
    """Return the columns with a name for times; ``time`` comes first.

    Ignored columns are left out, but ``time`` itself is always read.

    A name with a unit, such as ``time_ms`` or ``millis``, counts if there is no other, and then a
    name such as ``elapsed``.
    """
    read = (column for column in table.columns if column == TIMES[0] or column not in ignored)
    plain = {column: split_header(column)[0] for column in read}
    # T is a temperature.
    named = [
        column
        for name in TIMES
        for column, bare in plain.items()
        if bare.lower() == name and bare != "T"
    ]
    with_unit = [column for column, bare in plain.items() if unit_of_times(bare) is not None]
    elapsed = [column for column, bare in plain.items() if bare.lower().startswith(ELAPSED)]
    return named or with_unit or elapsed


def likely_times(table: Columns, ignored: Collection[str] = ()) -> str | None:
    """Return the first column of dates, or else of increasing numbers, if there is one.

    A count of the rows increases, too. A column in a unit of time comes first, and may repeat a
    value: a logger may round its times.
    """
    columns = [column for column in table.columns if column not in ignored]
    if (rounded := _never_decreasing(table, columns)) is not None:
        return rounded
    increasing = None
    for column in columns:
        cells = [cell for cell in table.texts(column) if cell]
        if len(set(cells[:FEW])) > 1 and all(map(is_date, cells[:FEW])):
            return column
        numbers = [float(cell) for cell in cells if is_number(cell)]
        are_times = len(numbers) == len(cells) > 1 and all(a < b for a, b in pairwise(numbers))
        if increasing is None and are_times:
            increasing = column
    return increasing


def _never_decreasing(table: Columns, columns: Sequence[str]) -> str | None:
    """Return the only column in a unit of time whose values never decrease, if there is one."""
    found = []
    for column in columns:
        cells = table.texts(column)
        if table.units.get(column, "").lower() in SECONDS and all(map(is_number, cells)):
            numbers = [float(cell) for cell in cells if cell]
            if len(set(numbers)) > 1 and all(a <= b for a, b in pairwise(numbers)):
                found.append(column)
    return found[0] if len(found) == 1 else None


def date_and_clock(table: Columns) -> tuple[str, str] | None:
    """Return a column of dates and one of times of day, whatever their names, if there are both."""
    dates, clocks = [], []
    for column in table.columns:
        cells = [cell for cell in table.texts(column)[:FEW] if cell]
        if cells and all(map(CLOCK.match, cells)):
            clocks.append(column)
        elif cells and all(is_date(cell) and ":" not in cell for cell in cells):
            dates.append(column)
    return (dates[0], clocks[0]) if dates and clocks else None


def episode_column(table: Columns, times: NDArray[np.float64], time: TimeColumn) -> str | None:
    """Return the first column that changes exactly where the times start again, if there is one."""
    restarts = np.flatnonzero(times[1:] < times[:-1])
    if not 0 < restarts.size * MIN_EPISODE_SAMPLES <= len(times):
        return None
    for column in table.columns:
        cells = np.array(table.texts(column))
        changes = np.flatnonzero(cells[1:] != cells[:-1])
        if column not in time.columns and np.array_equal(changes, restarts):
            return column
    return None


def changing_label(table: Columns, rows: NDArray[np.intp]) -> str | None:
    """Return the first column of a few texts that changes after each of some rows, if any."""
    for column in table.columns if rows.size else ():
        cells = table.texts(column)
        is_label = 1 < len(set(cells)) <= len(cells) // 2 and not any(map(is_number, cells))
        if is_label and all(cells[row] != cells[row + 1] for row in rows.tolist()):
            return column
    return None


def read_times(table: Columns, column: TimeColumn, stated: StatedUnits) -> Times:
    """Return the times of all rows; dates count from the first row.

    The unit of dates is the unit of time of the system, or seconds if it states none.

    Raises:
        InputError: a cell is neither a number nor a date like the first one, or the unit of time
            is not known.
    """
    if not column.columns:
        return Times(column.step * np.arange(len(table), dtype=np.float64))
    cells = _joined(table, column)
    first = next((cell for cell in cells if cell), "")
    where = table.header_location(column.last)
    header = table.units.get(column.last) or unit_of_times(column.last)
    if not is_date(first):
        convert = stated.state(TIME, header, where, "time")
        return Times(convert(table.numbers(column.last)))
    unit = stated.system.units.get(TIME, "s")
    if unit.strip().lower() not in SECONDS:
        problem = f"the recording has dates, but the unit of time is {unit!r}"
        hint = f"use one of {', '.join(SECONDS)}; or write times as numbers"
        raise InputError(problem, where=stated.system.where(f"system.units.{TIME}"), hint=hint)
    seconds, form = read_dates(cells, lambda row: table.location(row, column.last), where)
    stated.state(TIME, unit, where, "time")
    length = SECONDS[unit.strip().lower()]
    return Times(seconds / length, lambda text: seconds_until(text, first, form) / length)


def _joined(table: Columns, column: TimeColumn) -> list[str]:
    parts = [table.texts(name) for name in column.columns]
    return [" ".join(texts).strip() for texts in zip(*parts, strict=True)]


def _has_clock(table: Columns, column: str) -> bool:
    cells = table.texts(column)
    return bool(cells) and CLOCK.match(cells[0]) is not None
