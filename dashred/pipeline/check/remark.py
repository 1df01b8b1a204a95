"""Remarks of a check."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Remark:
    """One result of a check.

    Attributes:
        text: the result as a sentence without a full stop.
        kind: ok, warning (review before trusting a run), to do (incomplete), or error (a run would
            refuse the input).
        hint: what to do about it.
    """

    text: str
    kind: Literal["ok", "warning", "to do", "error"] = "ok"
    hint: str | None = None


def warning(text: str, hint: str | None = None) -> Remark:
    """Return a remark of kind warning."""
    return Remark(text, "warning", hint)


def shortened(names: list[str], most: int = 4) -> str:
    """Return the first names and the number of the others: ``s1, s2 and 7 more``."""
    if len(names) <= most + 1:
        return ", ".join(names)
    return f"{', '.join(names[:most])} and {len(names) - most} more"
