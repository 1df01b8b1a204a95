"""The period of a course without a form, if it repeats itself."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

# Harmonics of the fit, step between frequencies in periods over the record, and the fewest and the
# most periods in it.
HARMONICS, STEP, FEWEST, MOST = 3, 0.02, 2.0, 40.0
# Share of the variance that a periodic course has to explain.
MIN_SHARE = 0.8
REFINEMENTS = 8

Array = NDArray[np.float64]


def course_period(times: Array, values: Array) -> tuple[float, float] | None:
    """Return the period of a course and its standard deviation; None if it does not repeat.

    The course is fitted by three harmonics of every frequency. The best frequency is refined by
    Gauss–Newton steps, and the residuals give its standard deviation.

    Args:
        times: evenly spaced, ``(time,)``.
        values: of the course, ``(time,)``.
    """
    duration, spread = times[-1] - times[0], float(values.var())
    turns = np.arange(FEWEST, min(MOST, len(times) / 8), STEP)
    if spread == 0 or not len(turns):
        return None
    frequencies = 2 * math.pi * turns / duration
    misfits = [float(_residual(times, values, w).var()) for w in frequencies]
    best = int(np.argmin(misfits))
    if misfits[best] > (1 - MIN_SHARE) * spread or best == 0:
        return None
    frequency, std = float(frequencies[best]), 0.0
    for _ in range(REFINEMENTS):
        shift, std = _shift(times, values, frequency)
        frequency += shift
    period = 2 * math.pi / frequency
    return period, std * period / frequency


def _columns(times: Array, frequency: float) -> Array:
    waves = [np.ones_like(times)]
    for k in range(1, HARMONICS + 1):
        waves += [np.sin(k * frequency * times), np.cos(k * frequency * times)]
    return np.stack(waves, axis=1)


def _residual(times: Array, values: Array, frequency: float) -> Array:
    columns = _columns(times, frequency)
    residual: Array = values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
    return residual


def _shift(times: Array, values: Array, frequency: float) -> tuple[float, float]:
    """Return the Gauss–Newton step of the frequency and its standard deviation."""
    columns = _columns(times, frequency)
    amplitudes = np.linalg.lstsq(columns, values, rcond=None)[0]
    slope = np.zeros_like(times)
    for k in range(1, HARMONICS + 1):
        sine, cosine = amplitudes[2 * k - 1 : 2 * k + 1]
        angle = k * frequency * times
        slope += k * times * (sine * np.cos(angle) - cosine * np.sin(angle))
    whole = np.column_stack([columns, slope])
    solution = np.linalg.lstsq(whole, values, rcond=None)[0]
    left = values - whole @ solution
    variance = float(left @ left) / max(1, len(times) - whole.shape[1])
    return float(solution[-1]), math.sqrt(variance * np.linalg.pinv(whole.T @ whole)[-1, -1])
