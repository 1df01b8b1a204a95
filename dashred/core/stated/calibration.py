"""The unknown gain and offset of a sensor as the user states them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from dashred.core.errors import InputError, nearest

KEY = "recording.calibration"
# The gain and the offset of a calibrated sensor.
NEUTRAL = {"gain": 1.0, "offset": 0.0}
PARTS = ("value", "spread")
HINT = "for example {gain: 0.1, offset: fitted}: a spread, or fitted if nothing is known"


class StatedPart(NamedTuple):
    """What is known of a gain or an offset.

    Attributes:
        value: expected value.
        spread: its standard deviation; None if nothing is known.
    """

    value: float
    spread: float | None


def parse_calibration(given: Any, where: Callable[[str], str]) -> dict[str, dict[str, StatedPart]]:
    """Return ``recording.calibration`` by name of a sensor, then by ``gain`` and ``offset``.

    Args:
        given: the value of the key.
        where: returns the location of a dotted key.

    Raises:
        InputError: it is not a section of sections, or a gain or an offset is neither ``fitted``,
            nor a positive spread, nor a value with a spread.
    """
    if given is None:
        return {}
    found: dict[str, dict[str, StatedPart]] = {}
    for name, parts in _section(given, KEY, where).items():
        key = f"{KEY}.{name}"
        found[str(name)] = {}
        for part, stated in _section(parts, key, where).items():
            own = f"{key}.{part}"
            if part not in NEUTRAL:
                raise InputError(
                    f"unknown key {own}", where=where(own), hint=nearest(str(part), NEUTRAL)
                )
            found[str(name)][part] = _parse_part(stated, part, own, where)
    return found


def _section(given: Any, key: str, where: Callable[[str], str]) -> Mapping[str, Any]:
    if not isinstance(given, Mapping) or not given:
        what = f"{key} must be a section of keys; got {given!r}"
        raise InputError(what, where=where(key), hint=HINT)
    return given


def _parse_part(given: Any, part: str, key: str, where: Callable[[str], str]) -> StatedPart:
    stated = given if isinstance(given, Mapping) else {"spread": given}
    for name in stated:
        if name not in PARTS:
            own = f"{key}.{name}"
            raise InputError(f"unknown key {own}", where=where(own), hint=nearest(str(name), PARTS))
    value, spread = stated.get("value", NEUTRAL[part]), stated.get("spread", "fitted")
    if not _is_number(value) or (part == "gain" and value == 0):
        what = f"the value of {key} is {value!r}, but must be a number"
        place = where(f"{key}.value")
        raise InputError(what + " other than 0" * (part == "gain"), where=place, hint=HINT)
    if spread == "fitted":
        return StatedPart(float(value), None)
    if not _is_number(spread) or spread <= 0:
        what = f"{key} is {spread!r}, but must be fitted or a positive spread"
        raise InputError(what, where=where(key), hint=HINT)
    return StatedPart(float(value), float(spread))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
