"""A front that runs around a ring: where it stands, and how steep it is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def follow_front(values: Array, length: float) -> tuple[Array, Array]:
    """Return place and width of the steepest slope, ``(time,)`` each.

    The place is counted on around the ring, between grid points by a parabola through the slopes
    there; the width is ``(max u − min u) / max |∂u/∂x|``.

    Args:
        values: of a field, ``(time, point)``, evenly around the ring.
        length: around it.
    """
    points = values.shape[1]
    spacing = length / points
    k = 2j * np.pi * np.fft.rfftfreq(points, d=spacing)
    slope = np.fft.irfft(k * np.fft.rfft(values, axis=1), n=points, axis=1)
    # A pulse has two sides: the steeper one is its front, and stays it.
    slope = slope if slope.max() > -slope.min() else -slope
    at = slope.argmax(axis=1)
    rows = np.arange(len(values))
    left, here, right = (slope[rows, (at + shift) % points] for shift in (-1, 0, 1))
    bend = left - 2 * here + right
    shift = np.where(bend < 0, (left - right) / np.where(bend < 0, 2 * bend, 1.0), 0.0)
    place = np.unwrap((at + shift) * spacing, period=length)
    return place, np.ptp(values, axis=1) / np.where(here > 0, here, np.inf)
