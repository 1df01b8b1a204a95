"""Tell the inputs that change in steps from those that vary smoothly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Most changes of an input in steps are followed by a repeated value: more than this share.
FOLLOWED = 0.5
# A change by at most this many of the smallest differences between values may be rounding.
STEPS = 2.0
# The smallest difference between at most so many values may be a step of a staircase. Sensors count
# in at most this many units of the last decimal digit.
FEW_VALUES, COUNT = 8, 5.0
DECIMALS = 9
# Differences below this share of the largest value are rounding errors of the subtraction.
ROUNDING = 1e-9


def changes_in_steps(values: NDArray[np.float64]) -> bool:
    """Return whether an input stays at a value, and then jumps to another one.

    An input with two values, on and off, does. Of others, most changes are followed by a repeated
    value, and are larger than the resolution of the readings: a rounded reading of something smooth
    repeats its values, too, but changes by its last digit. The resolution is the smallest
    difference between two values; of an input with few values, that of its last decimal digit, but
    steps of equal length are no rounding.

    Args:
        values: of the input, ``(sample,)``; NaN where a cell is empty.
    """
    known = values[np.isfinite(values)]
    changes = np.diff(known)
    least = ROUNDING * float(np.abs(known).max(initial=0.0))
    changes[np.abs(changes) <= least] = 0.0
    changed = np.flatnonzero(changes)
    if not len(changed):
        return False
    apart = np.diff(np.unique(known))
    apart = apart[apart > least]
    if len(apart) == 1:
        return True
    # A change of the last sample has none that could follow.
    followed = changes[changed[changed < len(changes) - 1] + 1] == 0
    if not len(followed) or followed.mean() <= FOLLOWED:
        return False
    rounding = STEPS * float(apart.min())
    if len(apart) < FEW_VALUES:
        # A test with steps of equal length.
        stays = np.diff(changed)
        if len(stays) > 1 and np.ptp(stays) <= 1:
            return True
        rounding = COUNT * _last_digit(known, least)
    return float(np.median(np.abs(changes[changed]))) > rounding + least


def _last_digit(values: NDArray[np.float64], least: float) -> float:
    """Return the unit of the last decimal digit of values, which is 1 or less."""
    units = (10.0**-digits for digits in range(DECIMALS))
    exact = (u for u in units if (np.abs(values - np.round(values / u) * u) <= least).all())
    return next(exact, 0.0)
