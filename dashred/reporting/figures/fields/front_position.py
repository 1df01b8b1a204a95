"""Position and width of a front on a periodic axis."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Refinement of the grid: on the original grid, the steepest slope would oscillate as the front
# moves from point to point.
REFINEMENT = 8


def follow_front(values: Array, length: float) -> tuple[Array, Array]:
    """Return position and width of the steepest slope, ``(time,)`` each.

    The position is unwrapped, so it continues to increase or decrease after a period. The width is
    ``(max u − min u) / max |∂u/∂x|``. All extrema are those of the Fourier series, interpolated
    between grid points.

    Args:
        values: values of a field at evenly spaced points, ``(time, point)``.
        length: period of the axis.
    """
    points = values.shape[1]
    spacing = length / (REFINEMENT * points)
    series = np.fft.rfft(values, axis=1)
    if points % 2 == 0:
        # The Nyquist mode of an even grid is shared by two modes of the refined grid.
        series[:, -1] /= 2
    k = 2j * np.pi / length * np.arange(series.shape[1])
    fine, slope = (
        REFINEMENT * np.fft.irfft(part, n=REFINEMENT * points, axis=1)
        for part in (series, k * series)
    )
    # The front of a pulse is its steeper side, the same at all times.
    slope = slope if slope.max() > -slope.min() else -slope
    at, steepest = _peak(slope)
    extent = _peak(fine)[1] + _peak(-fine)[1]
    position = np.unwrap(at * spacing, period=length)
    return position, extent / np.where(steepest > 0, steepest, np.inf)


def _peak(values: Array) -> tuple[Array, Array]:
    """Return position, in points, and height of the maximum, by a parabola through three points.

    Args:
        values: values at points of a periodic axis, ``(time, point)``.
    """
    at, rows = values.argmax(axis=1), np.arange(len(values))
    left, here, right = (values[rows, (at + by) % values.shape[1]] for by in (-1, 0, 1))
    bend = left - 2 * here + right
    shift = np.where(bend < 0, (left - right) / np.where(bend < 0, 2 * bend, 1.0), 0.0)
    return at + shift, here - (left - right) * shift / 4
