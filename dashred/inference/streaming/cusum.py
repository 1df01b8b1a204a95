"""CUSUM charts of standardised innovations at a stated rate of false alarms.

Page (Biometrika 41, 1954): ``S_n = max(0, S_{n-1} + z_n − k)``, with an alarm at ``S_n > h``. With
k = δ/2 it is the fastest test for a shift of the mean by δ standard deviations.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ndtr

Array = NDArray[np.float64]

# Half of the smallest shift, in standard deviations, that is looked for.
REFERENCE = 0.5
# Nodes of the quadrature of Page's equation; the run length has converged to six digits.
NODES = 80
# Thresholds between which the one of a rate is looked for.
LOWEST, HIGHEST = 1e-3, 25.0
# A standardised innovation counts as at most this, so that a single outlier is no alarm.
CLIP = 4.5
# The sum of a chart is at most this multiple of the threshold, so that an alarm can end.
CEILING = 2.0


def run_length(threshold: float, reference: float = REFERENCE) -> float:
    """Return the mean number of samples of white noise to an alarm of a one-sided chart.

    Page's integral equation ``L(s) = 1 + L(0) Φ(k − s) + ∫_0^h L(x) φ(x + k − s) dx``, solved with
    Gauss–Legendre nodes.

    Args:
        threshold: h, in standard deviations.
        reference: k.
    """
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    x, w = threshold / 2 * (nodes + 1), threshold / 2 * weights
    # The unknowns are L(0) and L at the nodes.
    s = np.concatenate([[0.0], x])
    kernel = np.empty((NODES + 1, NODES + 1))
    kernel[:, 0] = ndtr(reference - s)
    density = np.exp(-((x[None] + reference - s[:, None]) ** 2) / 2) / math.sqrt(2 * math.pi)
    kernel[:, 1:] = density * w
    return float(np.linalg.solve(np.eye(NODES + 1) - kernel, np.ones(NODES + 1))[0])


def threshold_of(rate: float, reference: float = REFERENCE) -> float:
    """Return the threshold h of a one-sided chart with a rate of false alarms per sample.

    Args:
        rate: of white noise, between 1e-9 and 0.1.
        reference: k.
    """

    def excess(threshold: float) -> float:
        return math.log(run_length(threshold, reference) * rate)

    return float(brentq(excess, LOWEST, HIGHEST, xtol=1e-6))


@dataclass
class Charts:
    """One-sided charts that run beside each other.

    The rates of false alarms of rare and separate alarms add up: each chart has the stated rate
    divided by their number.

    Attributes:
        count: number of charts.
        rate: of false alarms of all charts together, per sample.
        sums: S of each chart.
        zeros: number of the sample at which the sum of each chart was zero the last time.
        samples: number of samples so far.
    """

    count: int
    rate: float
    threshold: float = field(init=False)
    sums: Array = field(init=False)
    zeros: NDArray[np.int64] = field(init=False)
    samples: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        """Choose the threshold, and begin at zero."""
        self.threshold = threshold_of(self.rate / self.count)
        self.sums = np.zeros(self.count)
        self.zeros = np.zeros(self.count, dtype=np.int64)

    def add(self, values: Array) -> None:
        """Add a sample, ``(chart,)``; the chart of a value that is NaN does not change."""
        self.samples += 1
        step = np.minimum(values, CLIP) - REFERENCE
        step[np.isnan(step)] = 0.0
        np.clip(self.sums + step, 0.0, CEILING * self.threshold, out=self.sums)
        self.zeros[self.sums == 0.0] = self.samples

    @property
    def alarms(self) -> NDArray[np.bool_]:
        """Which charts are above the threshold, ``(chart,)``."""
        return self.sums > self.threshold

    def begin_again(self) -> None:
        """Set all sums to zero."""
        self.sums[:] = 0.0
        self.zeros[:] = self.samples
