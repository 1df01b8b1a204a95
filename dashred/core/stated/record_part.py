"""The part of a recording that a configuration states."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from dashred.core.errors import InputError

BEGIN, END = "recording.begin", "recording.end"
HINT = "give a number, in the unit of time of the system; or a date, if the recording has dates"


@dataclass(frozen=True)
class RecordPart:
    """The samples with ``begin <= t <= end``.

    Attributes:
        begin, end: a time in the unit of the system, a date as a text, or None for no bound.
    """

    begin: float | str | None = None
    end: float | str | None = None

    @property
    def is_whole(self) -> bool:
        """Whether it is the whole recording."""
        return self.begin is None and self.end is None

    def __str__(self) -> str:
        """Return the bounds in words: ``from 10 to the end``."""
        bounds = zip((self.begin, self.end), ("the beginning", "the end"), strict=True)
        begin, end = (
            word if bound is None else bound if isinstance(bound, str) else f"{bound:.10g}"
            for bound, word in bounds
        )
        return f"from {begin} to {end}"


WHOLE = RecordPart()


def parse_part(begin: Any, end: Any, where: Callable[[str], str]) -> RecordPart:
    """Return the part that a configuration states.

    Raises:
        InputError: a bound is neither a finite number nor a text, or the end is not after the
            beginning.
    """
    for key, bound in ((BEGIN, begin), (END, end)):
        is_number = isinstance(bound, int | float) and not isinstance(bound, bool)
        if bound is None or (is_number and math.isfinite(bound)):
            continue
        if not isinstance(bound, str) or not bound.strip():
            raise InputError(f"{key} is not a time: {bound!r}", where=where(key), hint=HINT)
    if isinstance(begin, int | float) and isinstance(end, int | float) and not begin < end:
        problem = f"{END} must be after {BEGIN}; got {end:g} after {begin:g}"
        raise InputError(problem, where=where(END))
    return RecordPart(begin, end)
