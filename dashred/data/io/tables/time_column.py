"""The times of a recording: the column that has them, as numbers or as dates."""

from __future__ import annotations

import re
from collections.abc import Sequence
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
from dashred.data.io.tables.table_layout import TIMES, split_header

SECONDS = {
    "ms": 1e-3,
    **dict.fromkeys(("s", "sec", "second", "seconds"), 1.0),
    **dict.fromkeys(("min", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hr", "hour", "hours"), 3600.0),
    **dict.fromkeys(("d", "day", "days"), 86400.0),
    **dict.fromkeys(("week", "weeks"), 7 * 86400.0),
    **dict.fromkeys(("yr", "year", "years"), 365.25 * 86400.0),
}
DAY = 86400.0
# Cells that are looked at to guess which column has the times.
FEW = 20
CLOCK = re.compile(r"\d{1,2}:\d{2}(:\d{2}([.,]\d+)?)?")
ISO = re.compile(r"\d{4}([-/.])\d{1,2}\1\d{1,2}")
LOCAL = re.compile(
    r"\d{1,2}(?P<mark>[./-])\d{1,2}(?P=mark)(?P<year>\d{4}|\d{2})"
    r"( \d{1,2}:\d{2}(?P<seconds>:\d{2}(?P<fraction>[.]\d+)?)?(?P<half> [AaPp][Mm])?)?"
)
WRITE = "write dates as 2024-05-17 12:30:00, or times as numbers, such as seconds since the start"


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


def find_time_column(table: Columns, step: float | None = None) -> TimeColumn:
    """Find the column ``time``, or another one with a name for times, such as ``Timestamp``.

    Of the columns ``Date`` and ``Time``, both are used if the second has times of day.

    Args:
        table: the recording.
        step: time from row to row, if it is known, for a table in which no column may have times.

    Raises:
        InputError: there is no such column and no step, or there are several columns.
    """
    candidates = named_times(table)
    times, dates = ([c for c in candidates if c.lower() == name] for name in ("time", "date"))
    if len(times) == len(dates) == 1 and _has_clock(table, times[0]):
        return TimeColumn((dates[0], times[0]))
    if "time" in table.columns:
        return TimeColumn(("time",))
    if len(candidates) == 1:
        return TimeColumn((candidates[0],))
    if candidates:
        problem = f"which column has the times: {', '.join(candidates)}?"
        hint = f"name it: recording.columns={{time: {candidates[0]}}}"
        raise InputError(problem, where=table.path, hint=hint)
    likely = likely_times(table)
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
    return _is_date(first)


def named_times(table: Columns) -> list[str]:
    """Return the columns with a name for times; ``time`` comes first."""
    plain = {column: split_header(column)[0] for column in table.columns}
    # T is a temperature.
    return [
        column
        for name in TIMES
        for column, bare in plain.items()
        if bare.lower() == name and bare != "T"
    ]


def likely_times(table: Columns) -> str | None:
    """Return the first column whose cells may be increasing times or dates, if there is one."""
    for column in table.columns:
        cells = [cell for cell in table.texts(column) if cell]
        numbers = [float(cell) for cell in cells if is_number(cell)]
        if len(numbers) == len(cells) > 1 and all(a < b for a, b in pairwise(numbers)):
            return column
        if cells and all(map(_is_date, cells[:FEW])):
            return column
    return None


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


def _is_date(cell: str) -> bool:
    return bool(CLOCK.fullmatch(cell) or ISO.match(cell) or LOCAL.fullmatch(cell))


def read_times(table: Columns, column: TimeColumn, stated: StatedUnits) -> NDArray[np.float64]:
    """Return the times of all rows, ``(row,)``; dates count from the first row.

    The unit of dates is the unit of time of the system, or seconds if it states none.

    Raises:
        InputError: a cell is neither a number nor a date like the first one, or the unit of time
            is not known.
    """
    if not column.columns:
        return column.step * np.arange(len(table), dtype=np.float64)
    cells = _joined(table, column)
    first = next((cell for cell in cells if cell), "")
    header = table.units.get(column.last)
    if not _is_date(first):
        convert = stated.state(TIME, header, table.header_location(column.last), "time")
        return convert(table.numbers(column.last))
    unit = stated.system.units.get(TIME, "s")
    if unit.strip().lower() not in SECONDS:
        problem = f"the recording has dates, but the unit of time is {unit!r}"
        hint = f"use one of {', '.join(SECONDS)}; or write times as numbers"
        raise InputError(problem, where=stated.system.where(f"system.units.{TIME}"), hint=hint)
    seconds = _seconds(cells, first, table, column)
    stated.state(TIME, unit, table.header_location(column.last), "time")
    return seconds / SECONDS[unit.strip().lower()]


def _joined(table: Columns, column: TimeColumn) -> list[str]:
    parts = [table.texts(name) for name in column.columns]
    return [" ".join(texts).strip() for texts in zip(*parts, strict=True)]


def _has_clock(table: Columns, column: str) -> bool:
    cells = table.texts(column)
    return bool(cells) and CLOCK.match(cells[0]) is not None


def _seconds(
    cells: Sequence[str], first: str, table: Columns, column: TimeColumn
) -> NDArray[np.float64]:
    """Return dates or times of day in seconds since the first one; NaN where a cell is empty."""
    if CLOCK.fullmatch(first):
        tried = [_since_midnight(cells)]
    elif ISO.match(first):
        tried = [_parsed([_with_hyphens(cell) for cell in cells], "ISO8601")]
    else:
        tried = [_parsed(cells, form) for form in _local_formats(first)]
    empty = np.array([not cell for cell in cells])
    whole = [found for found in tried if not np.isnan(found[~empty]).any()]
    if not whole:
        missing = np.isnan(tried[0]) & ~empty
        row = int(missing.argmax())
        problem = f"{cells[row]!r} is not a date like the first one, {first!r}"
        raise InputError(problem, where=table.location(row, column.last), hint=WRITE)
    forward = [found for found in whole if (np.diff(found[~empty]) > 0).all()] or whole
    if any(not np.array_equal(found, forward[0], equal_nan=True) for found in forward[1:]):
        problem = f"in dates such as {first!r}, is the day or the month first?"
        raise InputError(problem, where=table.header_location(column.last), hint=WRITE)
    return forward[0]


def _parsed(cells: Sequence[str], form: str) -> NDArray[np.float64]:
    """Return dates of a format in seconds since the first one; NaN where a cell is not one."""
    import pandas as pd

    found = pd.to_datetime(pd.Series(cells, dtype=object), format=form, utc=True, errors="coerce")
    first = found.first_valid_index()
    if first is None:
        return np.full(len(cells), np.nan)
    # Seconds since 1970 would lose all digits beyond the microsecond.
    elapsed = (found - found[first]).dt.total_seconds()
    return np.asarray(elapsed.to_numpy(dtype=np.float64))


def _with_hyphens(cell: str) -> str:
    """Write ``2024/5/17 12:30`` as ``2024-05-17 12:30``."""
    date, mark, clock = cell.partition("T" if "T" in cell else " ")
    date = "-".join(part.zfill(2) for part in re.split(r"[-/.]", date))
    clock = clock.strip().replace(",", ".")
    # An hour of one digit: 9:30.
    return f"{date}{mark}{'0' if clock[1:2] == ':' else ''}{clock}"


def _local_formats(first: str) -> list[str]:
    """Return the formats of a local date; a date with points has the day first."""
    match = LOCAL.fullmatch(first)
    assert match
    year = "%Y" if len(match["year"]) == 4 else "%y"
    clock = ""
    if ":" in first:
        hour = "%I" if match["half"] else "%H"
        clock = f" {hour}:%M" + (":%S" if match["seconds"] else "")
        clock += ".%f" if match["fraction"] else ""
        clock += " %p" if match["half"] else ""
    mark = match["mark"]
    orders = ("%d", "%m"), ("%m", "%d")
    likely = orders[:1] if mark == "." else orders
    return [mark.join((*order, year)) + clock for order in likely]


def _since_midnight(cells: Sequence[str]) -> NDArray[np.float64]:
    """Return times of day in seconds since the first one; NaN where a cell is not one.

    A step back by more than half a day is midnight.
    """
    seconds = np.full(len(cells), np.nan)
    days, previous = 0, -np.inf
    for row, cell in enumerate(cells):
        if not CLOCK.fullmatch(cell):
            continue
        hours, minutes, *rest = cell.replace(",", ".").split(":")
        found = 3600 * int(hours) + 60 * int(minutes) + (float(rest[0]) if rest else 0.0)
        days += previous - found > DAY / 2
        seconds[row], previous = found + DAY * days, found
    return seconds - seconds[np.isfinite(seconds)][0]
