"""Kinds of windows, for true windows and for those in findings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

from dashred.core.findings.law_schema import Region

TrueWindow = tuple[str, float | None, float | None, float]
"""``(of, from, to, edge)``; a bound may be None."""


class WindowKind(NamedTuple):
    """What a window bounds: an axis, ``t``, or a field on one side of a threshold."""

    of: str
    side: Literal["above", "below"] | None = None


def window_kind(window: TrueWindow | None) -> WindowKind | None:
    """Return the kind of a true window; None if the term acts everywhere."""
    if window is None:
        return None
    of, begin, end, _ = window
    if of == "t" or (begin is not None and end is not None):
        return WindowKind(of)
    return WindowKind(of, "above" if end is None else "below")


def region_kind(region: Sequence[Region] | None) -> WindowKind | None:
    """Return the kind of the region of a term in findings; None if it acts everywhere."""
    return bounds_kind(region[0]) if region else None


def bounds_kind(region: Region | None) -> WindowKind | None:
    """Return the kind of one region; None if there is none."""
    if region is None:
        return None
    if "axis" in region:
        return WindowKind(region["axis"])
    return WindowKind(region["field"], "above" if "above" in region else "below")
