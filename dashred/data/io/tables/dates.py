"""Dates and times of day in a table, as loggers write them."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

DAY = 86400.0
# A step longer than this many others is a gap.
LONG_STEP = 10.0
ISO_FORMAT, CLOCK_FORMAT = "ISO8601", "clock"
# A time of day, or a time since the start: 100:30:00, 1.04:30:00, 1 day, 4:30:00.
CLOCK = re.compile(
    r"(?:(?P<days>\d+)(?:\.| days?,? ))?"
    r"(?P<hours>\d{1,3}):(?P<minutes>\d{2})(?::(?P<seconds>\d{2}(?:[.,]\d+)?))?"
)
ISO = re.compile(r"\d{4}([-/.])\d{1,2}\1\d{1,2}")
MONTH = "(?:jan|feb|mar|apr|may|jun|jul|aug|sep|oct|nov|dec)[a-z]*"
LOCAL = re.compile(
    rf"\d{{1,2}}(?P<mark>[./-]|[ -](?={MONTH}))(?:\d{{1,2}}|(?P<month>{MONTH}))(?P=mark)"
    r"(?P<year>\d{4}|\d{2})"
    r"( \d{1,2}:\d{2}(?P<seconds>:\d{2}(?P<fraction>[.]\d+)?)?(?P<half> [AaPp][Mm])?)?",
    re.IGNORECASE,
)
# The offset of a time zone after a time of day.
OFFSET = re.compile(r":\d{2}[\d.,:]*\s*(Z|[+-]\d{2}:?\d{2})$")
WRITE = "write dates as 2024-05-17 12:30:00, or times as numbers, such as seconds since the start"


def is_date(cell: str) -> bool:
    """Return whether a cell is a date or a time of day."""
    return bool(CLOCK.fullmatch(cell) or ISO.match(cell) or LOCAL.fullmatch(cell))


def read_dates(
    cells: Sequence[str], location: Callable[[int], str], header: str
) -> tuple[NDArray[np.float64], str]:
    """Return dates or times of day in seconds since the first one, and their format.

    Args:
        cells: of the column; the first one that is not empty is a date.
        location: of a row, for error messages.
        header: location of the header of the column.

    Returns:
        Seconds, ``(row,)``, NaN where a cell is empty; and the format for :func:`seconds_until`.

    Raises:
        InputError: a cell is not a date like the first one, or the day cannot be told from the
            month.
    """
    first = next(cell for cell in cells if cell)
    formats = _formats(first)
    tried = [_since_first(cells, form) for form in formats]
    empty = np.array([not cell for cell in cells])
    whole = [at for at, found in enumerate(tried) if not np.isnan(found[~empty]).any()]
    if not whole:
        row = int((np.isnan(tried[0]) & ~empty).argmax())
        problem = f"{cells[row]!r} is not a date like the first one, {first!r}"
        raise InputError(problem, where=location(row), hint=WRITE)
    forward = [at for at in whole if (np.diff(tried[at][~empty]) > 0).all()] or whole
    # A month that is read for a day makes a long gap at midnight.
    forward = [at for at in forward if _is_steady(tried[at][~empty])] or forward
    chosen = tried[forward[0]]
    if any(not np.array_equal(tried[at], chosen, equal_nan=True) for at in forward[1:]):
        problem = f"in dates such as {first!r}, is the day or the month first?"
        raise InputError(problem, where=header, hint=WRITE)
    return chosen, formats[forward[0]]


def _is_steady(times: NDArray[np.float64]) -> bool:
    """Return whether no step is much longer than most."""
    steps = np.diff(times)
    return bool(len(steps) and steps.max() <= LONG_STEP * np.median(steps))


def seconds_until(text: str, first: str, form: str) -> float:
    """Return the seconds from the first date of a column to another one; NaN if it is no date.

    A time of day is that after the first one. Of a date alone it is the midnight at its beginning.
    The time zone is that of the first one.

    Args:
        text: a date like those of the column, or in the order year, month, day.
        first: the first date of the column.
        form: format of the column.
    """
    if form == CLOCK_FORMAT:
        if not CLOCK.fullmatch(text):
            return np.nan
        elapsed = float(_since_first([first, text], form)[1])
        return elapsed if elapsed >= 0 else elapsed % DAY
    begin, zone = _moments([first], form)[0], OFFSET.search(first)
    if zone and not OFFSET.search(text):
        text = f"{text}{'' if ':' in text else ' 00:00'}{zone[1]}"
    for candidate in (form, form.partition(" ")[0], ISO_FORMAT):
        if candidate != ISO_FORMAT or ISO.match(text):
            moment = _moments([text], candidate)[0]
            if moment == moment:
                return float((moment - begin).total_seconds())
    return np.nan


def _formats(first: str) -> list[str]:
    if CLOCK.fullmatch(first):
        return [CLOCK_FORMAT]
    return [ISO_FORMAT] if ISO.match(first) else _local_formats(first)


def _since_first(cells: Sequence[str], form: str) -> NDArray[np.float64]:
    """Return dates of a format in seconds since the first one; NaN where a cell is not one."""
    if form == CLOCK_FORMAT:
        return _since_midnight(cells)
    found = _moments(cells, form)
    first = found.first_valid_index()
    if first is None:
        return np.full(len(cells), np.nan)
    # Seconds since 1970 would lose all digits beyond the microsecond.
    elapsed = (found - found[first]).dt.total_seconds()
    return np.asarray(elapsed.to_numpy(dtype=np.float64))


def _moments(cells: Sequence[str], form: str) -> pd.Series:
    """Return the dates of a format; NaT where a cell is not one."""
    import pandas as pd

    written = [_with_hyphens(cell) for cell in cells] if form == ISO_FORMAT else cells
    series = pd.Series(written, dtype=object)
    return pd.to_datetime(series, format=form, utc=True, errors="coerce")


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
    orders = [("%d", "%m"), ("%m", "%d")]
    likely = orders[:1] if mark == "." else orders
    if match["month"]:
        # May is the name of the month and its abbreviation.
        likely = [("%d", "%b"), ("%d", "%B")]
    return [mark.join((*order, year)) + clock for order in likely]


def _since_midnight(cells: Sequence[str]) -> NDArray[np.float64]:
    """Return times of day, or since a start, in seconds since the first one; NaN for other cells.

    A step back by more than half a day is midnight.
    """
    seconds = np.full(len(cells), np.nan)
    days, previous = 0, -np.inf
    for row, cell in enumerate(cells):
        if (match := CLOCK.fullmatch(cell)) is None:
            continue
        found = DAY * int(match["days"] or 0) + 3600 * int(match["hours"])
        found += 60 * int(match["minutes"]) + float((match["seconds"] or "0").replace(",", "."))
        days += previous - found > DAY / 2
        seconds[row], previous = found + DAY * days, found
    return seconds - seconds[np.isfinite(seconds)][0]
