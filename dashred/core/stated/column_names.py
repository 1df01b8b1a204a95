"""Names of the columns of a table in a configuration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dashred.core.errors import InputError

HINT = (
    "list all names, [time, T, u], for a table without a header; or give the header of a column by "
    "its name here, {time: Zeit, T: Temperature 1}; without a header, {time: 1} is the first column"
)
# Columns of a long table: the sensor of each row, and its reading.
SENSOR, VALUE = "sensor", "value"
LONG = ("time", "episode", SENSOR, VALUE)


def parse_columns(columns: Any, where: str) -> tuple[tuple[str, ...] | None, dict[str, str]]:
    """Return the names of all columns, or the headers of some by name.

    Args:
        columns: ``recording.columns``: a list, a mapping, or None.
        where: location of the key.

    Raises:
        InputError: it is something else, or a name is empty or occurs twice.
    """
    if columns is None:
        return None, {}
    if isinstance(columns, Mapping):
        values = columns.values()
        texts: Sequence[Any] = [str(text) if type(text) is int else text for text in values]
    elif isinstance(columns, list) and columns:
        texts = columns
    else:
        problem = "recording.columns is neither a list nor a mapping"
        raise InputError(problem, where=where, hint=HINT)
    for text in texts:
        if not isinstance(text, str) or not text.strip():
            problem = f"recording.columns: {text!r} is not the name of a column"
            raise InputError(problem, where=where, hint=HINT)
    names = [text.strip() for text in texts]
    if isinstance(columns, Mapping):
        headers = dict(zip(map(str, columns), names, strict=True))
        own = {name: header for name, header in headers.items() if name in LONG}
        # In a long table, a sensor may have the name of a column.
        is_long = {SENSOR, VALUE} <= set(own)
        others = [header for name, header in headers.items() if name not in own]
        for listed in (list(own.values()), others) if is_long else (names,):
            _check_unique(listed, where)
        return None, headers
    _check_unique(names, where)
    return tuple(names), {}


def _check_unique(names: Sequence[str], where: str) -> None:
    if repeated := next((name for name in names if names.count(name) > 1), None):
        problem = f"recording.columns contains {repeated!r} twice"
        raise InputError(problem, where=where, hint="names must be unique")
