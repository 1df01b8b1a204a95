"""Time scale of the traces of a recording, and the sampling step that resolves it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from dashred.data.clocks.resampling import native_step
from dashred.data.recording import Recording

# This many samples per period resolve a wave; more add little information.
SAMPLES_PER_PERIOD = 16
# A suggested step keeps at least this many samples.
MIN_SAMPLES_KEPT = 150
# A change is lost if a reading is farther from its interpolation than this many noise σ, plus this
# share of the std of its trace. Smaller ones are sensor faults, or errors of the interpolation.
LOST, LOST_SHARE = 6.0, 0.1
# A spline through fewer samples shows nothing.
FEWEST_KEPT = 8
# A trace that varies by less than this many noise σ has no measurable time scale.
MIN_SIGNAL_TO_NOISE = 3.0


def samples_per_change(recording: Recording, noise: NDArray[np.float64]) -> dict[str, int]:
    """Return, by sensor, the number of samples in 1/16 of a period of its trace.

    The structure function ``D(k) = ⟨(y_{i+k} − y_i)²⟩ − 2σ²`` of a sine wave of period P is
    ``2 var (1 − cos 2πk/P)``. The result is the first lag k at which D reaches the value that a
    sine wave has at ``k = P/16``. Sensors that show only noise are omitted.

    Args:
        recording: sampled at nearly equal steps.
        noise: σ of each sensor, ``(sensor,)``, in its unit.
    """
    found = {}
    for name, values, sigma in zip(recording.names, recording.values.T, noise, strict=True):
        variance = float(np.nanvar(values)) - sigma**2
        if variance <= (MIN_SIGNAL_TO_NOISE * sigma) ** 2 or variance <= 0:
            continue
        reached = 2 * variance * (1 - math.cos(2 * math.pi / SAMPLES_PER_PERIOD)) + 2 * sigma**2
        lag = _first_lag(values, reached)
        if lag is not None:
            found[name] = lag
    return found


def suggested_step(
    recording: Recording, lags: dict[str, int], noise: NDArray[np.float64]
) -> float | None:
    """Return a step of n samples, of at most 1/16 of the fastest sensor's period.

    The step leaves at least 150 samples, and no change between its samples that is far
    above the noise: a short transient may be all that shows a fast process. The result is None if
    the step is shorter than two steps of the recording.

    Args:
        recording: sampled at nearly equal steps.
        lags: result of :func:`samples_per_change`.
        noise: σ of each sensor, ``(sensor,)``, in its unit.
    """
    if not lags or min(lags.values()) < 2:
        return None
    own = native_step(recording.times)
    most = float(recording.times[-1] - recording.times[0]) / MIN_SAMPLES_KEPT
    step = round_down(min(own * min(lags.values()), most))
    # Each nth sample: nothing needs to be interpolated.
    while (every := int(step / own + 1e-6)) >= 2:
        if not _loses_changes(recording, noise, every):
            return float(f"{every * own:.6g}")
        step = round_down(step / 2)
    return None


def _loses_changes(recording: Recording, noise: NDArray[np.float64], every: int) -> bool:
    """Return whether each nth sample alone does not show what the others show.

    The readings are interpolated between each nth sample, by a spline. Changes are lost if the
    difference from two samples within one step is far above the noise.
    """
    limits = LOST * noise + LOST_SHARE * recording.trace_std()
    for values, limit in zip(recording.values.T, limits, strict=True):
        known = np.flatnonzero(~np.isnan(values))
        kept = known[::every]
        if len(kept) < FEWEST_KEPT:
            continue
        inside = known[known <= kept[-1]]
        spline = CubicSpline(recording.times[kept], values[kept])
        lost = np.abs(spline(recording.times[inside]) - values[inside]) > limit
        if (lost[:-1] & lost[1:]).any():
            return True
    return False


def round_down(value: float) -> float:
    """Return the largest 1, 2 or 5 times a power of ten that is at most ``value``."""
    power = math.floor(math.log10(value) + 1e-9)
    lead = next(n for n in (5, 2, 1) if n * 10.0**power <= value * (1 + 1e-9))
    return float(f"{lead}e{power}")


def _first_lag(values: NDArray[np.float64], reached: float) -> int | None:
    """Return the first lag at which the mean square change is at least ``reached``."""
    longest = len(values) // 2
    lag = 1
    while lag <= longest and not _mean_square_change(values, lag) >= reached:
        lag *= 2
    if lag > longest:
        return None
    low, high = lag // 2, lag
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (
            (low, middle) if _mean_square_change(values, middle) >= reached else (middle, high)
        )
    return high


def _mean_square_change(values: NDArray[np.float64], lag: int) -> float:
    squares = np.square(values[lag:] - values[:-lag])
    seen = squares[~np.isnan(squares)]
    return float(seen.mean()) if seen.size else 0.0
