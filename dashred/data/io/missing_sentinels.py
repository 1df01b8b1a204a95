"""Detection of sentinels: numbers such as -999 or 1e20 that a logger writes for missing values."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# A sentinel occurs at least this often and is this many median deviations from the median.
MIN_REPEATS, MIN_DEVIATIONS = 2, 30.0


def sentinel_counts(values: NDArray[np.float64]) -> dict[float, int]:
    """Return the likely sentinels of a trace with the number of times each occurs.

    A sentinel is far from the median, no other value is within half that distance of it, and it
    occurs repeatedly with exactly the same digits. Noise does not repeat exactly, and a real pulse
    passes through intermediate values.

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
    isolated = np.minimum(steps[:-1], steps[1:]) > far / 2
    distant = (far > MIN_DEVIATIONS * deviation) & (deviation > 0)
    found = (counts >= MIN_REPEATS) & distant & isolated
    return {float(n): int(c) for n, c in zip(numbers[found], counts[found], strict=True)}


def mask_sentinels(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return traces ``(time, sensor)`` with sentinels replaced by NaN."""
    found = values.copy()
    for column in found.T:
        column[np.isin(column, list(sentinel_counts(column)))] = np.nan
    return found
