"""Numbers that loggers write where they have read nothing: -999, 9999, 1e20."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# What is repeated to the last digit, so many times, and stands so many median deviations off.
REPEATED, FAR = 2, 30.0


def missing_marks(values: NDArray[np.float64]) -> dict[float, int]:
    """Return the numbers of a trace that look like marks of a missing value, and how often each.

    One far from the rest, to which no other comes half as near, and that is there more than once to
    the last digit: noise does not repeat itself, and pulses rise through what lies between.

    Args:
        values: of one sensor, ``(time,)``; NaN where missing.
    """
    known = values[~np.isnan(values)]
    if not len(known):
        return {}
    middle = np.median(known)
    deviation = float(np.median(np.abs(known - middle)))
    numbers, counts = np.unique(known, return_counts=True)
    far = np.abs(numbers - middle)
    steps = np.concatenate([[np.inf], np.diff(numbers), [np.inf]])
    alone = np.minimum(steps[:-1], steps[1:]) > far / 2
    marks = (counts >= REPEATED) & (far > FAR * deviation) & alone & (deviation > 0)
    return {float(n): int(c) for n, c in zip(numbers[marks], counts[marks], strict=True)}


def without_marks(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return traces ``(time, sensor)`` with such numbers missing."""
    found = values.copy()
    for column in found.T:
        column[np.isin(column, list(missing_marks(column)))] = np.nan
    return found
