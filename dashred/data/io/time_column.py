"""The times of a recording: the column that has them, as numbers or as dates."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.core.units import TIME
from dashred.data.io.columns import Columns
from dashred.data.io.stated_units import StatedUnits

# Names of the column, in any capitalisation; ``time`` itself comes first.
NAMES = ("time", "t", "times", "timestamp", "datetime", "date")
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
        columns: the column of the times; or the column of the date, then that of the time of day.
    """

    columns: tuple[str, ...]

    @property
    def last(self) -> str:
        """The column that error messages name."""
        return self.columns[-1]


def find_time_column(table: Columns) -> TimeColumn:
    """Find the column ``time``, or another one with a name for times, such as ``Timestamp``.

    Of the columns ``Date`` and ``Time``, both are used if the second has times of day.

    Raises:
        InputError: there is no such column, or several.
    """
    found = {name: [c for c in table.columns if c.lower() == name] for name in NAMES}
    times, dates = found["time"], found["date"]
    if len(times) == len(dates) == 1 and _has_clock(table, times[0]):
        return TimeColumn((dates[0], times[0]))
    if "time" in table.columns:
        return TimeColumn(("time",))
    candidates = [column for name in NAMES for column in found[name]]
    if len(candidates) == 1:
        return TimeColumn((candidates[0],))
    if candidates:
        problem = f"which column has the times: {', '.join(candidates)}?"
        hint = "name this column 'time' in the header"
        raise InputError(problem, where=table.path, hint=hint)
    hint = f"its columns are {', '.join(table.columns[:12])}: name one of them 'time'"
    raise InputError("the recording has no column 'time'", where=table.path, hint=hint)


def read_times(table: Columns, column: TimeColumn, stated: StatedUnits) -> NDArray[np.float64]:
    """Return the times of all rows, ``(row,)``; dates count from the first row.

    The unit of dates is the unit of time of the system, or seconds if it states none.

    Raises:
        InputError: a cell is neither a number nor a date like the first one, or the unit of time
            is not known.
    """
    cells = _joined(table, column)
    first = next((cell for cell in cells if cell), "")
    header = table.units.get(column.last)
    if not (CLOCK.fullmatch(first) or ISO.match(first) or LOCAL.fullmatch(first)):
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
