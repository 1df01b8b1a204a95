"""How right the named cause is, and how well the place where a law acts was found.

Nothing here opens a seal: the scorer hands over the truth that it read.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from dashred.evaluation.twins.scoring import TrueTerm, system_of
from dashred.evaluation.twins.window_kinds import kind_found, kind_of


class Hidden(Protocol):
    """What else than a law was hidden; see :class:`dashred.evaluation.twins.sealing.Concealed`."""

    @property
    def parameters(self) -> Mapping[str, float]:
        """True values of parameters."""

    @property
    def faults(self) -> Sequence[Any]:
        """Of sensors: ``sensor`` and ``kind``."""

    @property
    def spread(self) -> float:
        """Of the start, in units of its prior's."""


def score_cause(findings: Mapping[str, Any], law: bool, hidden: Hidden) -> bool | None:
    """Return whether the verdict names what was hidden; of a fault, sensor and kind too.

    Null without a verdict. Of several hidden causes any one is right.
    """
    verdict = findings.get("verdict")
    if verdict is None:
        return None
    if verdict == "sensor-fault":
        told = findings["causes"][0]
        return any(f.sensor == told["sensor"] and f.kind == told["fault"] for f in hidden.faults)
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
    """Return how well the window was found; null where the truth has none.

    ``overlap`` of a box: intersection over union; ``onset`` and ``threshold``: how far off, in the
    unit of time and of the field. All are null where no window of that kind was found.
    """
    windows = [t.window for t in truth if t.window is not None]
    if not windows:
        return None
    true = windows[0]
    score: dict[str, float | None] = {"overlap": None, "onset": None, "threshold": None}
    regions = [entry["region"] for entry in findings["terms"] or [] if entry.get("region")]
    if not regions or kind_of(true) != kind_found(regions[0]):
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
        score["overlap"] = _overlap((region["from"], region["to"]), (begin, end), length)
    return score


def _overlap(
    found: tuple[float, float], true: tuple[float | None, float | None], length: float
) -> float:
    """Return intersection over union of two intervals on a periodic axis."""
    assert true[0] is not None and true[1] is not None
    wide = (found[1] - found[0]) + (true[1] - true[0])
    shared = max(
        max(0.0, min(found[1] + turn, true[1]) - max(found[0] + turn, true[0]))
        for turn in (-length, 0.0, length)
    )
    return shared / (wide - shared)
