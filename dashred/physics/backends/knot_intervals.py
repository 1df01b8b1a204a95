"""The interval of a piecewise linear function, in compiled code."""

from __future__ import annotations

import numba
import numpy as np

from dashred.physics.backends.numba_backend import Array


@numba.njit(nogil=True, cache=True, error_model="numpy")
def find_interval(knots: Array, t: float) -> tuple[int, float]:
    """Return the index of the knot before ``t`` and the relative position to the next, 0 to 1."""
    k = min(max(int(np.searchsorted(knots, t)) - 1, 0), len(knots) - 2)
    fraction = (t - knots[k]) / (knots[k + 1] - knots[k])
    return k, min(max(fraction, 0.0), 1.0)
