"""Cells of an image whose values are given at points."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

Extent = tuple[float, float, float, float]
Points = Float[np.ndarray, " point"]


def image_extent(x: Points, y: Points) -> Extent:
    """Return the extent of an image whose cells are centred at evenly spaced points."""
    return (*_edges(x), *_edges(y))


def frame_points(axes: Axes, x: Points, y: Points) -> None:
    """Limit the axes to the points: the outer half cells are outside the domain."""
    axes.set(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))


def _edges(points: Points) -> tuple[float, float]:
    half = float(points[-1] - points[0]) / (len(points) - 1) / 2
    return float(points[0]) - half, float(points[-1]) + half


def scale_reference(kinds: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the values of a field that alone set its colour scale.

    These are the truth or, without it, the corrected simulation or else the first method, so that
    a bad estimate does not set the scale.
    """
    best = (kinds[name] for name in ("truth", "corrected") if name in kinds)
    return next(best, next(iter(kinds.values())))
