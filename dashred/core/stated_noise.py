"""The noise of a sensor as a text or a number: ``0.1`` or ``5%``."""

from __future__ import annotations

import contextlib
import math
from typing import Any

from dashred.core.errors import InputError

HINT = "for example 0.1, in the unit of the readings, or 5% of their standard deviation"


def parse_noise(given: Any, what: str, where: str) -> tuple[float | None, float | None]:
    """Return a stated noise as a std and a share of the readings' std, of which one is None.

    Args:
        given: a number, or a text such as ``0.1`` or ``5%``.
        what: name of the value, for error messages.
        where: location, for error messages.

    Raises:
        InputError: it is neither a positive number nor a positive share.
    """
    text = given.strip() if isinstance(given, str) else given
    is_share = isinstance(text, str) and text.endswith("%")
    bare = text.removesuffix("%").strip() if isinstance(text, str) else text
    number = math.nan
    # float() also reads 1_0 and True.
    if isinstance(bare, int | float | str) and not isinstance(bare, bool) and "_" not in str(bare):
        with contextlib.suppress(ValueError):
            number = float(bare)
    if not 0 < number < math.inf:
        problem = f"{what} is {given!r}, but must be a positive number or share"
        raise InputError(problem, where=where, hint=HINT)
    return (None, number / 100) if is_share else (number, None)
