"""What a window bounds, of a hidden window and of one in the findings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

from dashred.core.findings.law_schema import Region

TrueWindow = tuple[str, float | None, float | None, float]
"""``(of, from, to, edge)``; None for no bound."""


class WindowKind(NamedTuple):
    """What a window bounds: an axis, ``t``, or a field on one side of a threshold."""

    of: str
    side: Literal["above", "below"] | None = None


def kind_of(window: TrueWindow | None) -> WindowKind | None:
    """Return what a hidden window bounds; None everywhere."""
    if window is None:
        return None
    of, begin, end, _ = window
    if of == "t" or (begin is not None and end is not None):
        return WindowKind(of)
    return WindowKind(of, "above" if end is None else "below")


def kind_found(region: Sequence[Region] | None) -> WindowKind | None:
    """Return what the region of a term in the findings bounds; None everywhere."""
    return kind_of_region(region[0]) if region else None


def kind_of_region(region: Region | None) -> WindowKind | None:
    """Return what one region bounds; None everywhere."""
    if region is None:
        return None
    if "axis" in region:
        return WindowKind(region["axis"])
    return WindowKind(region["field"], "above" if "above" in region else "below")
