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
    found = stats.linregress(np.log(sizes), np.log(values))
    if len(sizes) < 3:
        return Exponent(float(found.slope), None)
    quantile = float(stats.t.ppf((1 + LEVEL) / 2, len(sizes) - 2))
    return Exponent(float(found.slope), quantile * float(found.stderr))


def fit_line(sizes: Sequence[float], values: Sequence[float]) -> Line | None:
    """Fit ``y = a + b x`` by least squares; None for fewer than two sizes, or without growth."""
    growth = max(values, default=0.0) - min(values, default=0.0)
    if len(set(sizes)) < 2 or growth == 0:
        return None
    found = stats.linregress(sizes, values)
    rest = np.asarray(values) - found.intercept - found.slope * np.asarray(sizes)
    misfit = float(np.abs(rest).max() / growth)
    return Line(float(found.intercept), float(found.slope), misfit)
