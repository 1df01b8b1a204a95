"""Scores of the named cause and of the region in which a law acts.

This module does not open a seal: the scorer passes the truth to it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from dashred.evaluation.twins.scoring import TrueTerm, system_of
from dashred.evaluation.twins.window_kinds import region_kind, window_kind


class Hidden(Protocol):
    """Hidden causes other than terms; see :class:`dashred.evaluation.twins.sealing.Concealed`."""

    @property
    def parameters(self) -> Mapping[str, float]:
        """True values of the parameters that are misstated."""

    @property
    def faults(self) -> Sequence[Any]:
        """Sensor faults, each with a ``sensor`` and a ``kind``."""

    @property
    def spread(self) -> float:
        """Spread of the initial state over that of its prior."""


def score_cause(findings: Mapping[str, Any], law: bool, hidden: Hidden) -> bool | None:
    """Return whether the verdict names a hidden cause; for a fault, also its sensor and kind.

    None without a verdict. With several hidden causes, naming one of them is right.
    """
    verdict = findings.get("verdict")
    if verdict is None:
        return None
    if verdict == "sensor-fault":
        named = findings["causes"][0]
        return any(f.sensor == named["sensor"] and f.kind == named["fault"] for f in hidden.faults)
    right = {
        "missing-term": law,
        "parameter": bool(hidden.parameters),
        "initial-condition": hidden.spread > 1,
    }
    nothing = not hidden.faults and not any(right.values())
    return nothing if verdict == "nothing-missing" else right.get(verdict, False)


def score_region(
    findings: Mapping[str, Any], truth: Sequence[TrueTerm]
) -> dict[str, float | None] | None:
    """Return the errors of the window that was found; None if the truth has no window.

    ``overlap`` is the intersection over union of a box; ``onset`` and ``threshold`` are absolute
    errors in units of time and of the field. All are None if no window of that kind was found.
    """
    windows = [t.window for t in truth if t.window is not None]
    if not windows:
        return None
    true = windows[0]
    score: dict[str, float | None] = {"overlap": None, "onset": None, "threshold": None}
    regions = [entry["region"] for entry in findings["terms"] or [] if entry.get("region")]
    if not regions or window_kind(true) != region_kind(regions[0]):
        return score
    [region] = regions[0]
    of, begin, end, _ = true
    if of == "t":
        score["onset"] = abs(region["from"] - begin)
    elif "field" in region:
        place = region["above"] if end is None else region["below"]
        score["threshold"] = abs(place - (begin if end is None else end))
    else:
        length = float(system_of(findings).grid.axes[0].length)
        # A region that wraps around the axis ends before it begins.
        until = region["to"] + (length if region["to"] < region["from"] else 0.0)
        score["overlap"] = _overlap((region["from"], until), (begin, end), length)
    return score


def _overlap(
    found: tuple[float, float], true: tuple[float | None, float | None], length: float
) -> float:
    """Return intersection over union of two intervals on a periodic axis.

    The first may cross the end of the axis; its end is then smaller than its beginning.
    """
    assert true[0] is not None and true[1] is not None
    if found[0] > found[1]:
        found = (found[0] - length, found[1])
    wide = (found[1] - found[0]) + (true[1] - true[0])
    shared = max(
        max(0.0, min(found[1] + turn, true[1]) - max(found[0] + turn, true[0]))
        for turn in (-length, 0.0, length)
    )
    return shared / (wide - shared)
