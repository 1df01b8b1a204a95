"""Estimates of recordings, their spread and their innovations."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Analysis(NamedTuple):
    """The estimate of a sample of a recording.

    Attributes:
        state: the estimate, ``(field*point,)``.
        variances: of its errors, ``(field*point,)``.
        innovations: readings minus their forecasts, ``(known sensor,)``.
        expected: variances of the innovations, ``(known sensor,)``.
    """

    state: Array
    variances: Array
    innovations: Array
    expected: Array


class ObservedPath:
    """Estimates of recordings, sample by sample.

    Attributes:
        states: estimates by recording and sample, ``(field*point,)`` each.
        spreads: their standard deviations.

    Args:
        recordings: their number.
        beginning: number of samples whose innovations say how well the start was known, and are not
            counted.
    """

    def __init__(self, recordings: int, beginning: int) -> None:
        self.states: list[list[Array]] = [[] for _ in range(recordings)]
        self.spreads: list[list[Array]] = [[] for _ in range(recordings)]
        self._beginning = beginning
        self._squares: list[Array] = []
        self._cost = 0.0

    @property
    def mean_square(self) -> float:
        """Mean square of the innovations in expected standard deviations."""
        joined = np.concatenate(self._squares) if self._squares else np.empty(0)
        return float(joined.mean()) if len(joined) else 0.0

    @property
    def cost(self) -> float:
        """−2 times the logarithm of the density of the innovations, without its constant."""
        return self._cost if math.isfinite(self._cost) else math.inf

    def add(self, recording: int, found: Analysis) -> None:
        """Add the next sample of a recording."""
        self.states[recording].append(found.state)
        self.spreads[recording].append(np.sqrt(found.variances))
        if len(self.states[recording]) > self._beginning:
            self._squares.append(np.square(found.innovations) / found.expected)
            self._cost += float((np.log(found.expected) + self._squares[-1]).sum())
