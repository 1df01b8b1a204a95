"""Messages of a stream: a time and readings by sensor, as a line of CSV or as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

from dashred.core.errors import InputError
from dashred.pipeline.follow.remarks import Remarks

# Name of the column, and of the key of JSON, with the time.
TIME_COLUMN = "time"
# Separators of a line of CSV, in the order in which they are looked for in the header.
SEPARATORS = ("\t", ";", ",")
HINT = "the first line names the columns: time, and one for each sensor"
OBJECT = "{"


class Message(NamedTuple):
    """Some readings of one time; a reading that is NaN is missing."""

    time: float
    readings: Mapping[str, float]


class Source(Protocol):
    """Where messages come from.

    Attributes:
        ended: whether no further messages will come.
    """

    ended: bool

    def read(self, timeout: float) -> list[Message]:
        """Return the messages that have arrived; wait for the first one until the timeout."""

    def close(self) -> None:
        """Release the file or the connection."""


@dataclass
class LineReader:
    """Reads lines that are rows of a CSV, or objects of JSON.

    Args:
        place: what messages call the source.
        remarks: told of lines that are not read.
    """

    place: str
    remarks: Remarks
    _header: Sequence[str] = ()
    _separator: str = ","
    _rest: str = ""

    def feed(self, text: str) -> list[Message]:
        """Read text that ends anywhere; the part of a line at its end waits for the rest.

        Raises:
            InputError: the first line is not a header with a column ``time``.
        """
        *lines, self._rest = (self._rest + text).split("\n")
        messages = [self._line(line.strip(" \r")) for line in lines]
        return [message for message in messages if message is not None]

    def finish(self) -> list[Message]:
        """Read what is left at the end of a stream."""
        return self.feed("\n") if self._rest.strip() else []

    def _line(self, line: str) -> Message | None:
        if not line or line.startswith("#"):
            return None
        if line.startswith(OBJECT):
            return parse_json(line, self.place, self.remarks)
        if not self._header:
            self._read_header(line)
            return None
        cells = line.split(self._separator)
        if len(cells) != len(self._header):
            self.remarks.once("cells", f"{self.place}: a line does not have one cell per column")
            return None
        row = {name: number(cell) for name, cell in zip(self._header, cells, strict=True)}
        return _message(row, self.place, self.remarks)

    def _read_header(self, line: str) -> None:
        found = next((each for each in SEPARATORS if each in line), ",")
        names = [cell.strip().strip('"') for cell in line.lstrip("\ufeff").split(found)]
        if TIME_COLUMN not in names:
            what = f"the first line has no column {TIME_COLUMN!r}"
            raise InputError(what, where=self.place, hint=HINT)
        self._header, self._separator = names, found


def parse_json(text: str | bytes, place: str, remarks: Remarks) -> Message | None:
    """Return the message of a JSON object ``{"time": 1.5, "s1": 0.2}``; None if it is not one."""
    try:
        given = json.loads(text)
    except ValueError:
        given = None
    if not isinstance(given, dict):
        remarks.once("json", f"{place}: a message is not an object of JSON")
        return None
    return _message({str(k): number(v) for k, v in given.items()}, place, remarks)


def number(value: Any) -> float:
    """Return a finite number, or NaN for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return math.nan
    try:
        found = float(value)
    except (ValueError, OverflowError):
        return math.nan
    return found if math.isfinite(found) else math.nan


def _message(row: dict[str, float], place: str, remarks: Remarks) -> Message | None:
    time = row.pop(TIME_COLUMN, math.nan)
    if math.isnan(time):
        remarks.once("time", f"{place}: a message has no time that is a number; it is left out")
        return None
    return Message(time, row)
