"""Noise of readings that change as fast as they are sampled, such as those of a driven resonator.

Differences of such readings show the signal and not the noise. A combination of neighbouring
readings and of the inputs can cancel the signal: with ``r_i = y_i - Σ_k a_k y_{i+k} - Σ_k b_k
u_{i+k}``, white noise of variance σ² contributes ``(1 + Σ a²) σ²`` to the variance of r. What is
left of the signal adds to it, so that σ is at most ``√(var r / (1 + Σ a²))`` whatever a and b are.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from dashred.physics.backends.input_signals import InputSignals

Array = NDArray[np.float64]

# Orders of two differences. Both show the same σ of white noise, the higher one less of a signal.
LOW, HIGH = 3, 6
# Signals are fast if σ from the lower order is larger by this factor.
FAST = 2.0
# Neighbours on each side that predict a reading.
NEIGHBOURS = 3
# Each coefficient needs this many readings.
READINGS_PER_COEFFICIENT = 20
# A reading whose prediction errs by more than this many σ is left out of the next fit.
OUTLIER, FITS = 4.0, 4
# Relative variation above which steps are uneven.
MAX_STEP_VARIATION = 0.01
# Median absolute value of a standard normal variable.
NORMAL_MEDIAN_ABS = 0.6744897501960817


def is_fast(times: Array, values: Array) -> bool:
    """Return whether differences of the readings of a sensor show the signal, not the noise.

    Args:
        times: ``(time,)``; only even steps can show it.
        values: ``(time,)``, NaN where missing.
    """
    if not _are_even(times) or np.isfinite(values).sum() < READINGS_PER_COEFFICIENT * HIGH:
        return False
    return _difference_noise(values, LOW) > FAST * _difference_noise(values, HIGH) > 0


def predicted_noise(times: Array, values: Array, inputs: InputSignals) -> float:
    """Return an upper bound of σ from the prediction of readings; infinity if there are too few.

    Args:
        times: at even steps, ``(time,)``.
        values: readings of a sensor, ``(time,)``, NaN where missing.
        inputs: that drive the system.
    """
    around = _windows(values)
    others = np.delete(around, NEIGHBOURS, axis=1)
    driving = [_windows(found) for found in inputs.at(times).values()]
    columns = np.concatenate([others, *driving, np.ones((len(around), 1))], axis=1)
    whole = np.isfinite(columns).all(axis=1) & np.isfinite(around[:, NEIGHBOURS])
    columns, read = columns[whole], around[whole, NEIGHBOURS]
    if len(read) < READINGS_PER_COEFFICIENT * columns.shape[1]:
        return math.inf
    sizes = np.abs(columns).max(axis=0)
    sizes[sizes == 0] = 1.0
    columns, kept = columns / sizes, np.ones(len(read), dtype=bool)
    for _ in range(FITS):
        found, *_ = np.linalg.lstsq(columns[kept], read[kept])
        left = np.abs(read - columns @ found)
        typical = float(np.median(left)) / NORMAL_MEDIAN_ABS
        kept = left <= OUTLIER * typical
    weights = (found / sizes)[: 2 * NEIGHBOURS]
    freedom = len(read) / (len(read) - columns.shape[1])
    return typical * math.sqrt(freedom / (1 + float(weights @ weights)))


def _windows(values: Array) -> Array:
    """Return each value between its neighbours, ``(time - 2·neighbours, 2·neighbours + 1)``."""
    found: Array = sliding_window_view(values, 2 * NEIGHBOURS + 1)
    return found


def _are_even(times: Array) -> bool:
    steps = np.diff(times)
    return len(steps) > 2 * NEIGHBOURS and bool(np.ptp(steps) <= MAX_STEP_VARIATION * steps.mean())


def _difference_noise(values: Array, order: int) -> float:
    """Return σ of white noise whose differences of an order have the same median size."""
    rough = np.diff(values, n=order)
    rough = np.abs(rough[np.isfinite(rough)])
    typical = float(np.median(rough)) if rough.size else 0.0
    return typical / NORMAL_MEDIAN_ABS / math.sqrt(math.comb(2 * order, order))
