"""Fits of how seconds and memory grow."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import stats

LEVEL = 0.95


class Exponent(NamedTuple):
    """The power with which something grows.

    Attributes:
        value: p of ``y = c xᵖ``.
        half_width: of its 95 % interval; None for fewer than three sizes.
    """

    value: float
    half_width: float | None


class Line(NamedTuple):
    """A straight line.

    Attributes:
        constant: a of ``y = a + b x``.
        slope: b.
        misfit: the largest distance from the line, as a share of the growth of y.
    """

    constant: float
    slope: float
    misfit: float


def fit_exponent(sizes: Sequence[float], values: Sequence[float]) -> Exponent | None:
    """Fit ``log y = log c + p log x`` by least squares; None for fewer than two sizes."""
    if len(set(sizes)) < 2:
        return None
    x, y = np.log(sizes), np.log(values)
    slope, constant = np.polyfit(x, y, 1)
    free = len(x) - 2
    if free == 0:
        return Exponent(float(slope), None)
    variance = np.square(y - constant - slope * x).sum() / free
    error = np.sqrt(variance / np.square(x - x.mean()).sum())
    return Exponent(float(slope), float(stats.t.ppf((1 + LEVEL) / 2, free) * error))


def fit_line(sizes: Sequence[float], values: Sequence[float]) -> Line | None:
    """Fit ``y = a + b x`` by least squares; None for fewer than two sizes, or without growth."""
    x, y = np.asarray(sizes, dtype=float), np.asarray(values, dtype=float)
    if len(set(sizes)) < 2 or np.ptp(y) == 0:
        return None
    slope, constant = np.polyfit(x, y, 1)
    misfit = np.abs(y - constant - slope * x).max() / np.ptp(y)
    return Line(float(constant), float(slope), float(misfit))
