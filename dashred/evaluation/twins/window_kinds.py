"""What a window bounds: the same words for a hidden one and for one in the findings."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

TrueWindow = tuple[str, float | None, float | None, float]
"""``(of, from, to, edge)``; None for no bound."""

TEXT = re.compile(r"for (?:\S+ < )?(\w+) ([<>]) \S+\Z")


def kind_of(window: TrueWindow | None) -> str | None:
    """Return what a window bounds, and on which side: ``x``, ``t``, ``u above``."""
    if window is None:
        return None
    of, begin, end, _ = window
    if begin is not None and end is not None:
        return of
    return of if of == "t" else f"{of} {'above' if end is None else 'below'}"


def kind_found(region: Sequence[Mapping[str, Any]] | None) -> str | None:
    """Return the same of a region in the findings."""
    if not region:
        return None
    [only] = region
    if "axis" in only:
        return str(only["axis"])
    return f"{only['field']} {'above' if 'above' in only else 'below'}"


def kind_in_text(text: str | None) -> str | None:
    """Return the same of a text like ``for u > 0.6``, as alternatives have it."""
    if text is None:
        return None
    match = TEXT.fullmatch(text)
    assert match is not None, text
    of, side = match.groups()
    if text.count("<") == 2 or of == "t":
        return of
    return f"{of} {'above' if side == '>' else 'below'}"
