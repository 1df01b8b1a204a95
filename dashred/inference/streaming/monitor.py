"""Charts of the innovations of all sensors, and of the sum of their squares."""

from __future__ import annotations

import copy

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, ndtri

from dashred.inference.streaming.cusum import Charts
from dashred.inference.streaming.live_estimator import Analysed
from dashred.inference.streaming.whitening import Whitener

Array = NDArray[np.float64]

# Smallest tail probability that is told from zero.
SMALLEST = 1e-15


class Monitor:
    """Two-sided charts of every sensor, and one chart of the sum of squares.

    The sum of the squares of n whitened innovations has the χ² distribution with n degrees of
    freedom. Its chart gets the standard normal variable with the same tail probability.

    Args:
        innovations: whitens the innovations of the sensors in their expected standard deviations.
        serial: whitens the serial innovations, see :class:`.live_estimator.Analysed`.
        rate: of false alarms of all charts together, per sample.
    """

    def __init__(self, innovations: Whitener, serial: Whitener, rate: float) -> None:
        self._innovations, self._serial = innovations, serial
        self.sensors = len(innovations.mean)
        self.charts = Charts(2 * self.sensors + 1, rate)

    def add(self, analysed: Analysed, is_charted: bool = True) -> Array:
        """Add a sample; return the whitened innovations, ``(sensor,)``.

        Args:
            analysed: result of the filter.
            is_charted: whether the charts get the sample.
        """
        white = self._innovations.add(analysed.innovation / analysed.innovation_std)
        serial = self._serial.add(analysed.serial)
        if is_charted:
            self.charts.add(np.concatenate([white, -white, [_score_of_squares(serial)]]))
        return white

    @property
    def heights(self) -> Array:
        """The higher of the two charts of each sensor, in thresholds, ``(sensor,)``."""
        return self.charts.sums[:-1].reshape(2, -1).max(axis=0) / self.charts.threshold

    @property
    def height_of_squares(self) -> float:
        """The chart of the sum of squares, in thresholds."""
        return float(self.charts.sums[-1] / self.charts.threshold)

    def samples_since_zero(self, sensor: int | None) -> int:
        """Return how many samples ago the chart of a sensor left zero; None is the sum of squares.

        Of the two charts of a sensor the higher one counts.
        """
        chart = 2 * self.sensors
        if sensor is not None:
            pair = self.charts.sums[:-1].reshape(2, -1)[:, sensor]
            chart = sensor + int(pair.argmax()) * self.sensors
        return int(self.charts.samples - self.charts.zeros[chart])

    def copy(self) -> Monitor:
        """Return an independent copy in the same state."""
        return copy.deepcopy(self)


def _score_of_squares(serial: Array) -> float:
    """Return the sum of squares as a standard normal variable; NaN without any innovation."""
    seen = serial[~np.isnan(serial)]
    if not len(seen):
        return np.nan
    return float(-ndtri(max(chdtrc(len(seen), float(seen @ seen)), SMALLEST)))
