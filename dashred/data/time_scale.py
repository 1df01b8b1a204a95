"""How fast a recording changes, and so how finely it is sampled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dashred.data.recording import Recording
from dashred.data.resampling import own_step

# A wave sampled so often a period is drawn smoothly; more samples of it say little new.
A_PERIOD = 16
# So many samples are left in any case.
KEPT = 100
# Where a trace varies by less than this many σ of its noise, there is nothing to time.
VISIBLE = 3.0


def samples_a_change(recording: Recording, noise: NDArray[np.float64]) -> dict[str, int]:
    """Return, by sensor, after how many samples its trace has moved on by 1/16 of a period.

    The structure function ``D(k) = ⟨(y_{i+k} − y_i)²⟩ − 2σ²`` of a wave is
    ``2 var (1 − cos 2πk/P)``; the first k at which it reaches what it is at k = P/16 is returned,
    whatever the trace's shape. Sensors in which nothing but noise is seen are left out.

    Args:
        recording: sampled at about equal steps.
        noise: σ of each sensor, ``(sensor,)``, in its unit.
    """
    found = {}
    for name, values, sigma in zip(recording.names, recording.values.T, noise, strict=True):
        variance = float(np.nanvar(values)) - sigma**2
        if variance <= (VISIBLE * sigma) ** 2 or variance <= 0:
            continue
        reached = 2 * variance * (1 - math.cos(2 * math.pi / A_PERIOD)) + 2 * sigma**2
        lag = _first_lag(values, reached)
        if lag is not None:
            found[name] = lag
    return found


def suggested_step(recording: Recording, lags: dict[str, int]) -> float | None:
    """Return a round step that keeps 1/16 of the fastest sensor's period.

    None if that is less than two of the recording's own. A hundred samples are left at least.

    Args:
        recording: as above.
        lags: of :func:`samples_a_change`.
    """
    if not lags or min(lags.values()) < 2:
        return None
    own = own_step(recording.times)
    most = float(recording.times[-1] - recording.times[0]) / KEPT
    round_step = rounded_down(min(own * min(lags.values()), most))
    return round_step if round_step >= 2 * own * (1 - 1e-9) else None


def rounded_down(value: float) -> float:
    """Return 1, 2 or 5 times a power of ten, at most ``value``."""
    power = math.floor(math.log10(value) + 1e-9)
    lead = next(n for n in (5, 2, 1) if n * 10.0**power <= value * (1 + 1e-9))
    return float(f"{lead}e{power}")


def _first_lag(values: NDArray[np.float64], reached: float) -> int | None:
    """Return the first lag at which the mean square change is at least ``reached``."""
    longest = len(values) // 2
    lag = 1
    while lag <= longest and not _change(values, lag) >= reached:
        lag *= 2
    if lag > longest:
        return None
    low, high = lag // 2, lag
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if _change(values, middle) >= reached else (middle, high)
    return high


def _change(values: NDArray[np.float64], lag: int) -> float:
    squares = np.square(values[lag:] - values[:-lag])
    seen = squares[~np.isnan(squares)]
    return float(seen.mean()) if seen.size else 0.0
