"""Localisation radii of a sample covariance."""

from __future__ import annotations

import math

from dashred.pipeline.problem import Problem

# As shares of the longest axis.
RADII = (math.inf, 0.3, 0.15)


def radii(problem: Problem) -> list[float]:
    """Return the candidate Gaspari-Cohn radii in units of the axes; infinite for none."""
    longest = max((axis.length for axis in problem.system.axes), default=math.inf)
    return list(dict.fromkeys(share * longest for share in RADII))


def radius_text(radius: float) -> str:
    """Return ``radius 1.5``, or ``not localised``."""
    return f"radius {radius:g}" if math.isfinite(radius) else "not localised"
