"""Find columns of a recording that are the rate of change of another column."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dashred.data.recording import Recording

# Smallest share of the variance of the changes that the integral must explain, and largest
# deviation of the slope of the regression from one.
MIN_EXPLAINED, MAX_SLOPE_ERROR = 0.98, 0.05
# Smallest number of stretches in a regression.
MIN_STRETCHES = 16


@dataclass(frozen=True)
class Rate:
    """``d(field)/dt = rate``, where the recording has both.

    Attributes:
        field, rate: names of the two columns.
        explained: share of the variance of the changes that the integral explains.
    """

    field: str
    rate: str
    explained: float


def find_rates(recording: Recording) -> dict[str, Rate]:
    """Return the columns whose changes are the integral of another column, by name.

    The relation ``y(t₂) − y(t₁) = ∫ v dt`` is tested over stretches of k = 1, 2, 4 … samples with
    the trapezoidal rule, because noise hides the changes over short stretches. A column is the rate
    of at most one other column.
    """
    candidates = [
        rate
        for field in recording.names
        for other in recording.names
        if field != other and (rate := _rate(recording, field, other)) is not None
    ]
    best: dict[str, Rate] = {}
    for rate in sorted(candidates, key=lambda rate: -rate.explained):
        if rate.field not in best and rate.rate not in {taken.rate for taken in best.values()}:
            best[rate.field] = rate
    return best


def accelerations(rates: Mapping[str, Rate]) -> tuple[str, ...]:
    """Return the columns that are the rate of a rate: functions of the state, and no fields."""
    found = {rate.rate for rate in rates.values()}
    return tuple(
        rates[name].rate for name in rates if name in found and rates[name].rate not in rates
    )


def _rate(recording: Recording, field: str, other: str) -> Rate | None:
    y = recording.values[:, recording.names.index(field)]
    v = recording.values[:, recording.names.index(other)]
    known = ~(np.isnan(y) | np.isnan(v))
    t, y, v = recording.times[known], y[known], v[known]
    if len(t) <= MIN_STRETCHES:
        return None
    integral = np.concatenate([[0.0], np.cumsum(np.diff(t) * (v[1:] + v[:-1]) / 2)])
    stretch, best = 1, 0.0
    while len(t) // stretch >= MIN_STRETCHES:
        slope, explained = _regress(np.diff(y[::stretch]), np.diff(integral[::stretch]))
        if abs(slope - 1) <= MAX_SLOPE_ERROR:
            best = max(best, explained)
        stretch *= 2
    return Rate(field, other, best) if best >= MIN_EXPLAINED else None


def _regress(changes: NDArray[np.float64], integrals: NDArray[np.float64]) -> tuple[float, float]:
    """Return the slope through the origin and the share of the variance that it explains."""
    power, spread = float(integrals @ integrals), float(changes @ changes)
    if power == 0 or spread == 0:
        return 0.0, 0.0
    slope = float(integrals @ changes) / power
    residual = changes - slope * integrals
    return slope, 1 - float(residual @ residual) / spread
