"""What a configuration says about the table of a recording: names, the step, the part."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from dashred.core.errors import InputError, nearest
from dashred.core.stated.column_names import LONG, SENSOR, VALUE
from dashred.core.stated.record_part import WHOLE, RecordPart
from dashred.core.unit_conversion import is_known_unit
from dashred.core.units import split_unit

# Names of a column of times, in any capitalisation; ``time`` itself comes first.
TIMES = ("time", "t", "times", "timestamp", "datetime", "date")
LETTERS_OF_TEMPERATURE = ("C", "F")
NUMBER = re.compile(r"[+-]?\d+(\.\d*)?")
# Names of a column of times that say the unit, in any capitalisation: these, and time_ms, t_s, ...
UNIT_OF_TIMES = {
    **dict.fromkeys(("micros", "microseconds"), "us"),
    **dict.fromkeys(("millis", "milliseconds"), "ms"),
    **dict.fromkeys(("secs", "seconds"), "s"),
    **dict.fromkeys(("mins", "minutes"), "min"),
    **dict.fromkeys(("hrs", "hours"), "h"),
    "days": "d",
    "weeks": "week",
    "years": "year",
}
STEMS = (*TIMES, "elapsed", "epoch", "uptime")
# Beginning of a name of a column of times, in any capitalisation.
ELAPSED = "elapsed"
ENDINGS = {"us": "us", "ms": "ms", "s": "s", "sec": "s", "min": "min", "h": "h", "d": "d"}
ENDINGS |= UNIT_OF_TIMES


@dataclass(frozen=True)
class TableLayout:
    """What is known of a table before it is read.

    Attributes:
        every_name: names of all columns, for a table without a header; None if it has one.
        headers: header of a column in the file, by the name that it has here.
        ignored: columns that are not read.
        step: time from row to row, for a table without times.
        used: names of columns in the configuration and in the table of sensors. A header that is
            one of these is a name as it stands, ``T (degC)``, and not a name with its unit.
        part: the samples that are used.
    """

    every_name: tuple[str, ...] | None = None
    headers: Mapping[str, str] = field(default_factory=dict)
    ignored: Collection[str] = ()
    step: float | None = None
    used: Collection[str] = ()
    part: RecordPart = WHOLE

    def rename(self, headers: Sequence[str], where: str) -> list[str]:
        """Return the headers with the names of the configuration in place of those in the file.

        The unit of a header remains: ``Time (s)`` becomes ``time [s]``. In a long table, a header
        that the file does not have is the name of a sensor.

        Raises:
            InputError: the file does not have one of the headers.
        """
        renamed = [header.strip() for header in headers]
        plain = [split_header(header)[0] for header in renamed]
        is_long = {SENSOR, VALUE} <= set(self.headers)
        for name in sorted(self.headers, key=lambda name: name not in LONG):
            header = self.headers[name]
            if header in renamed:
                place = renamed.index(header)
            elif header in plain:
                place = plain.index(header)
            elif is_long and name not in LONG:
                continue
            else:
                problem = f"recording.columns: the recording has no column {header!r}"
                raise InputError(problem, where=where, hint=nearest(header, renamed))
            bare, unit = split_header(headers[place])
            if unit is None and name == TIMES[0]:
                unit = unit_of_times(bare)
            renamed[place] = name if unit is None else f"{name} [{unit}]"
            # The number of a column may be the name of a sensor, too.
            plain[place] = name
        return renamed


def unit_of_times(name: str) -> str | None:
    """Return the unit of time in the name of a column, such as ``time_ms``; None without one."""
    lower = name.lower()
    stem, _, ending = lower.rpartition("_")
    # T_s is a temperature.
    if stem in STEMS and not name.startswith("T_"):
        return ENDINGS.get(ending)
    return UNIT_OF_TIMES.get(lower)


def split_header(header: str) -> tuple[str, str | None]:
    """Split a header from its unit: ``u [m]``, or ``u (m)`` and ``u, m`` if it is a known one.

    ``(C)`` and ``(F)`` are rarely a coulomb and a farad; they are left out. A remark may follow a
    unit after a comma: ``u, m (sensor 7)``.
    """
    name, unit = split_unit(header)
    if unit is not None:
        return name, unit
    before, _, rest = name.rpartition("(")
    # f(t) is a name.
    is_apart = before.endswith(" ") or before.lower() in TIMES
    if not before.strip() or not is_apart or not rest.endswith(")"):
        return _split_after_comma(name) or (name, None)
    written = rest[:-1].strip()
    if written in LETTERS_OF_TEMPERATURE:
        return before.strip(), None
    if is_known_unit(written):
        return before.strip(), written
    return _split_after_comma(before.strip()) or (name, None)


def _split_after_comma(name: str) -> tuple[str, str] | None:
    """Split a name from a known unit after a comma; None if there is none."""
    before, _, written = (part.strip() for part in name.rpartition(","))
    is_unit = before and written not in LETTERS_OF_TEMPERATURE and not NUMBER.fullmatch(written)
    return (before, written) if is_unit and is_known_unit(written) else None
