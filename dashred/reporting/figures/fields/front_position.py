"""A front that runs around a ring: where it stands, and how steep it is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Points of the finer grid for one of the field's own: read on those alone, the steepest slope
# would rise and fall as the front passes them.
FINER = 8


def follow_front(values: Array, length: float) -> tuple[Array, Array]:
    """Return place and width of the steepest slope, ``(time,)`` each.

    The place is counted on around the ring; the width is ``(max u − min u) / max |∂u/∂x|``. All
    extrema are those of the Fourier series, read between the grid points.

    Args:
        values: of a field, ``(time, point)``, evenly around the ring.
        length: around it.
    """
    points = values.shape[1]
    spacing = length / (FINER * points)
    series = np.fft.rfft(values, axis=1)
    if points % 2 == 0:
        # The highest wave of an even grid stands for two, of which the finer grid has one.
        series[:, -1] /= 2
    k = 2j * np.pi / length * np.arange(series.shape[1])
    fine, slope = (
        FINER * np.fft.irfft(part, n=FINER * points, axis=1) for part in (series, k * series)
    )
    # A pulse has two sides: the steeper one is its front, and stays it.
    slope = slope if slope.max() > -slope.min() else -slope
    at, steepest = _peak(slope)
    extent = _peak(fine)[1] + _peak(-fine)[1]
    place = np.unwrap(at * spacing, period=length)
    return place, extent / np.where(steepest > 0, steepest, np.inf)


def _peak(values: Array) -> tuple[Array, Array]:
    """Return place, in points, and height of the largest value, by a parabola through three.

    Args:
        values: ``(time, point)`` around a ring.
    """
    at, rows = values.argmax(axis=1), np.arange(len(values))
    left, here, right = (values[rows, (at + by) % values.shape[1]] for by in (-1, 0, 1))
    bend = left - 2 * here + right
    shift = np.where(bend < 0, (left - right) / np.where(bend < 0, 2 * bend, 1.0), 0.0)
    return at + shift, here - (left - right) * shift / 4
