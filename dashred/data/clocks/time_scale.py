"""Time scale of the traces of a recording, and the sampling step that resolves it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from dashred.data.clocks.resampling import native_step, resample
from dashred.data.recording import Recording

# This many samples per period resolve a wave; more add little information.
SAMPLES_PER_PERIOD = 16
# A suggested step keeps at least this many samples.
MIN_SAMPLES_KEPT = 150
# A change is lost if two averages in a row are farther from their interpolation than this many of
# their noise σ, plus this share of the std of the trace: ten times the error of a spline through 16
# samples of a period.
LOST, LOST_SHARE = 6.0, 0.003
# An average has at most so many readings, because rounding errors do not average out, and a step
# contains at least so many averages.
AVERAGED, BLOCKS_PER_STEP = 4, 4
# A spline through fewer samples shows nothing.
FEWEST_KEPT = 8
# A trace that varies by less than this many noise σ has no measurable time scale.
MIN_SIGNAL_TO_NOISE = 3.0


def samples_per_change(recording: Recording, noise: NDArray[np.float64]) -> dict[str, int]:
    """Return, by sensor, the number of samples in 1/16 of a period of its trace.

    The structure function ``D(k) = ⟨(y_{i+k} − y_i)²⟩ − 2σ²`` of a sine wave of period P is
    ``2 var (1 − cos 2πk/P)``. The result is the first lag k at which D reaches the value that a
    sine wave has at ``k = P/16``. Sensors that show only noise, or have no values, are omitted.

    Args:
        recording: sampled at nearly equal steps.
        noise: σ of each sensor, ``(sensor,)``, in its unit.
    """
    found = {}
    for name, values, sigma in zip(recording.names, recording.values.T, noise, strict=True):
        if np.isnan(values).all():
            continue
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
    return _longest_that_keeps(recording, noise, step)


def lost_change(
    recording: Recording, noise: NDArray[np.float64], step: float
) -> tuple[str, float] | None:
    """Return the first change in a recording that its samples on a clock do not show.

    Averages of a few readings have less noise. Those on the clock are interpolated by a spline. A
    change is lost if the difference from two others in a row is far above the noise, as in a
    response that is faster than the clock.

    Args:
        recording: the samples.
        noise: σ of each sensor, ``(sensor,)``, in its unit.
        step: of the clock.

    Returns:
        The sensor and the time; None if no change is lost.
    """
    most = float(recording.times[-1] - recording.times[0]) / FEWEST_KEPT
    count = int(step / native_step(recording.times)) // BLOCKS_PER_STEP
    count = min(max(count, 1), AVERAGED)
    limits = LOST * noise / math.sqrt(count) + LOST_SHARE * recording.trace_std()
    for index, (sensor, limit) in enumerate(zip(recording.sensors, limits, strict=True)):
        known = ~np.isnan(recording.values[:, index])
        times, values = _averages(recording.times[known], recording.values[known, index], count)
        if len(times) < FEWEST_KEPT or step > most:
            continue
        averaged = Recording((sensor,), times, values[:, None])
        thinned = resample(averaged, step, FEWEST_KEPT)[0]
        kept = ~np.isnan(thinned.values[:, 0])
        if kept.sum() < FEWEST_KEPT:
            continue
        spline = CubicSpline(thinned.times[kept], thinned.values[kept, 0])
        inside = times <= thinned.times[kept][-1]
        off = np.abs(spline(times[inside]) - values[inside]) > limit
        twice = np.flatnonzero(off[:-1] & off[1:])
        if twice.size:
            return sensor.name, float(times[twice[0]])
    return None


def _averages(
    times: NDArray[np.float64], values: NDArray[np.float64], count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the means of so many samples each, without those across a gap."""
    whole = len(times) - len(times) % count
    clock, read = times[:whole].reshape(-1, count), values[:whole].reshape(-1, count)
    spans = np.ptp(clock, axis=1)
    together = spans <= 2 * np.median(spans)
    return clock[together].mean(axis=1), read[together].mean(axis=1)


def step_that_keeps(recording: Recording, noise: NDArray[np.float64], step: float) -> float | None:
    """Return a step of n samples, shorter than ``step``, that loses no change; None without one.

    Args:
        recording: the samples.
        noise: σ of each sensor, ``(sensor,)``, in its unit.
        step: of a clock that loses a change.
    """
    return _longest_that_keeps(recording, noise, round_down(step / 2))


def _longest_that_keeps(
    recording: Recording, noise: NDArray[np.float64], step: float
) -> float | None:
    own = native_step(recording.times)
    # Each nth sample: nothing needs to be interpolated.
    while (every := int(step / own + 1e-6)) >= 2:
        tried = float(f"{every * own:.6g}")
        if lost_change(recording, noise, tried) is None:
            return tried
        step = round_down(step / 2)
    return None


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
