"""How far a reading reaches in a sample's covariance: the radii that are tried, and their words."""

from __future__ import annotations

import math

from dashred.pipeline.problem import Problem

# Of the longest axis.
RADII = (math.inf, 0.3, 0.15)


def radii(problem: Problem) -> list[float]:
    """Return the Gaspari-Cohn radii to choose from, in the axes' unit; infinite for none."""
    longest = max((axis.length for axis in problem.system.axes), default=math.inf)
    return list(dict.fromkeys(share * longest for share in RADII))


def radius_in_words(radius: float) -> str:
    """Return ``radius 1.5``, or ``not localised``."""
    return f"radius {radius:g}" if math.isfinite(radius) else "not localised"
