"""The time over which a sensor averages, as the user states it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from dashred.core.errors import InputError

KEY, INTERVAL = "recording.average", "interval"
HINT = "for example 0.5, in the unit of time of the system, or interval: since the sample before"


def parse_average(given: Any, where: Callable[[str], str]) -> dict[str, float | None]:
    """Return ``recording.average`` by name of a sensor; the name of all sensors is empty.

    None is the time since the sample before.

    Args:
        given: the value of the key.
        where: returns the location of a dotted key.

    Raises:
        InputError: a time is neither a positive number nor ``interval``.
    """
    if given is None:
        return {}
    by_name = given if isinstance(given, Mapping) else {"": given}
    found: dict[str, float | None] = {}
    for name, stated in by_name.items():
        is_number = isinstance(stated, int | float) and not isinstance(stated, bool)
        if stated != INTERVAL and not (is_number and 0 < stated < math.inf):
            key = f"{KEY}.{name}" if name else KEY
            what = f"{key} is {stated!r}, but must be a positive number or {INTERVAL}"
            raise InputError(what, where=where(key), hint=HINT)
        found[str(name)] = None if stated == INTERVAL else float(stated)
    return found
