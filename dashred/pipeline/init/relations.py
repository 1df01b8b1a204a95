"""Which columns of a recording are each other's rates of change."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dashred.data.recording import Recording

# Shares of the variance of a change that the integral has to explain, and of what it says of it.
EXPLAINED, NEAR_ONE = 0.98, 0.05
# Stretches of the record, at least, that this is told by.
FEWEST = 16


@dataclass(frozen=True)
class Rate:
    """``d(field)/dt = rate``, where the recording has both.

    Attributes:
        field, rate: names of the two columns.
        explained: share of the changes' variance that the integral explains.
    """

    field: str
    rate: str
    explained: float


def find_rates(recording: Recording) -> dict[str, Rate]:
    """Return the columns whose changes are the integral of another, by their names.

    Over stretches of k samples ``y(t₂) − y(t₁) = ∫ v dt`` (trapezoids) is tried for k = 1, 2, 4 …:
    a stretch may not be so short that noise hides the change. No column is the rate of two.
    """
    found = [
        rate
        for field in recording.names
        for other in recording.names
        if field != other and (rate := _rate(recording, field, other)) is not None
    ]
    best: dict[str, Rate] = {}
    for rate in sorted(found, key=lambda rate: -rate.explained):
        if rate.field not in best and rate.rate not in {taken.rate for taken in best.values()}:
            best[rate.field] = rate
    return best


def _rate(recording: Recording, field: str, other: str) -> Rate | None:
    y = recording.values[:, recording.names.index(field)]
    v = recording.values[:, recording.names.index(other)]
    known = ~(np.isnan(y) | np.isnan(v))
    t, y, v = recording.times[known], y[known], v[known]
    if len(t) <= FEWEST:
        return None
    integral = np.concatenate([[0.0], np.cumsum(np.diff(t) * (v[1:] + v[:-1]) / 2)])
    stretch, best = 1, 0.0
    while len(t) // stretch >= FEWEST:
        slope, explained = _regressed(np.diff(y[::stretch]), np.diff(integral[::stretch]))
        if abs(slope - 1) <= NEAR_ONE:
            best = max(best, explained)
        stretch *= 2
    return Rate(field, other, best) if best >= EXPLAINED else None


def _regressed(changes: NDArray[np.float64], integrals: NDArray[np.float64]) -> tuple[float, float]:
    """Return the slope through the origin, and the share of the changes that is explained."""
    power, spread = float(integrals @ integrals), float(changes @ changes)
    if power == 0 or spread == 0:
        return 0.0, 0.0
    slope = float(integrals @ changes) / power
    left = changes - slope * integrals
    return slope, 1 - float(left @ left) / spread
