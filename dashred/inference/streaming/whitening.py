"""Whiten innovations whose statistics on a known recording are not those of white noise.

The simulator, the noise and the ensemble are never exact, so that the innovations of a filter
differ a little from white noise of unit variance, even if nothing has changed. Charts need white
noise.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# A statistic differs from that of white noise by more than this many of its standard errors.
SIGNIFICANT = 3.0
# Fewer innovations of a sensor do not show whether they are white.
FEWEST = 20
# Number of samples over which a scale follows the stream.
MEMORY = 1000
# Squares are limited to this in the recent scale, so that a few outliers do not hide what follows.
LARGEST_SQUARE = 9.0


@dataclass
class Whitener:
    """``e = (z − m − φ (z' − m)) / (s √(1 − φ²) r)``, where z' is the innovation before z.

    Attributes:
        mean: m of each sensor, ``(sensor,)``.
        std: s.
        correlation: φ, between neighbouring samples.
        follows: whether the scale follows the stream: r² is then the recent mean square of e, and
            otherwise it is 1.
    """

    mean: Array
    std: Array
    correlation: Array
    follows: NDArray[np.bool_]
    _before: Array = field(init=False)
    _recent: Array = field(init=False)
    _is_plain: bool = field(init=False)

    def __post_init__(self) -> None:
        """Begin without an earlier innovation."""
        self._before = np.full(len(self.mean), np.nan)
        self._recent = np.ones(len(self.mean))
        self._is_plain = not self.is_needed.any()

    @classmethod
    def fit(cls, innovations: Array) -> Whitener:
        """Return what whitens the standardised innovations of a recording, ``(time, sensor)``.

        A mean, a scale or a correlation is used only where it is significant.
        """
        columns = [_statistics(column) for column in innovations.T]
        mean, std, correlation = (np.array(each) for each in zip(*columns, strict=True))
        return cls(mean, std, correlation, std != 1.0)

    @property
    def is_needed(self) -> NDArray[np.bool_]:
        """Which sensors have innovations that are not white noise of unit variance."""
        return (self.mean != 0) | (self.std != 1) | (self.correlation != 0)

    def add(self, innovations: Array) -> Array:
        """Return the whitened innovations of the next sample, ``(sensor,)``; NaN where missing."""
        if self._is_plain:
            return innovations
        centred = innovations - self.mean
        known = ~np.isnan(self._before)
        phi = np.where(known, self.correlation, 0.0)
        left = centred - phi * np.where(known, self._before, 0.0)
        white = left / (self.std * np.sqrt(1 - phi**2))
        self._before = centred
        result = white / np.sqrt(self._recent)
        grows = self.follows & ~np.isnan(white)
        square = np.minimum(white**2, LARGEST_SQUARE * self._recent)
        self._recent[grows] += (square[grows] - self._recent[grows]) / MEMORY
        return result

    def copy(self) -> Whitener:
        """Return an independent copy in the same state."""
        return copy.deepcopy(self)


def _statistics(innovations: Array) -> tuple[float, float, float]:
    """Return the significant mean, std and correlation; those of white noise where they are not."""
    seen = innovations[~np.isnan(innovations)]
    if len(seen) < FEWEST:
        return 0.0, 1.0, 0.0
    count = len(seen)
    mean, std = float(seen.mean()), float(seen.std())
    pairs = (innovations[1:] - mean) * (innovations[:-1] - mean)
    pairs = pairs[~np.isnan(pairs)]
    phi = float(np.clip(pairs.mean() / max(std, 1e-12) ** 2, -0.95, 0.95)) if len(pairs) else 0.0
    if abs(phi) < SIGNIFICANT / math.sqrt(count):
        phi = 0.0
    # Correlated samples determine a mean and a variance less well.
    independent = max(2.0, count * (1 - abs(phi)) / (1 + abs(phi)))
    if abs(mean) < SIGNIFICANT * std / math.sqrt(independent):
        mean = 0.0
    if abs(std**2 - 1) < SIGNIFICANT * math.sqrt(2 / independent):
        std = 1.0
    return mean, max(std, 1e-6), phi
