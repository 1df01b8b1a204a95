"""Differences of random pairs of states; their covariance is twice that of the states."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def random_differences(states: Array, count: int, rng: np.random.Generator) -> Array:
    """Return differences of random pairs of states, ``(count, field*point)``.

    Args:
        states: ``(state, field*point)``.
        count: number of pairs.
        rng: random number generator.
    """
    pairs = rng.integers(len(states), size=(2, count))
    found: Array = states[pairs[0]] - states[pairs[1]]
    return found
