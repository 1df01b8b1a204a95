"""Estimate of each sensor's noise from its trace."""

from __future__ import annotations

import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.data.fast_signals import is_fast, predicted_noise
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.data.stated.saturation import values_at_stop
from dashred.physics.backends.input_signals import InputSignals

# Third differences of white noise of variance σ² have variance (1 + 9 + 9 + 1) σ².
THIRD_DIFFERENCE_STD = math.sqrt(20.0)
# Relative variation above which steps are uneven; the clock of a logger always jitters a little.
MAX_STEP_VARIATION = 0.01
# Median absolute value of a standard normal variable.
NORMAL_MEDIAN_ABS = 0.6744897501960817
# Differences below this share of the largest reading are rounding errors of the subtraction.
ROUNDING = 1e-12
# The median of fewer differences is unreliable.
MIN_DIFFERENCES = 20


def noise_std(recording: Recording, *others: Recording) -> NDArray[np.float64]:
    """Return the noise std of each sensor, shape ``(sensor,)``, in its own unit.

    It is the stated std, or ``σ = median |Δ³y| / (0.6745 √20)``. Third differences (divided
    differences where samples are uneven) remove any quadratic over four samples, and the median
    ignores the few outliers that a front or a spike leaves. If most readings are repeated, because
    they are rounded to a step, σ is at least step/√12. If too few consecutive samples have
    no gap between them, the differences are taken across gaps. Readings of a system with inputs
    that change as fast as they are sampled are compared with their prediction
    (:mod:`dashred.data.fast_signals`).

    With several episodes, the estimate is the rms over the episodes in which the sensor changes.
    A sensor that never changes (stuck) gets the median of the sensors that read the same
    quantity.

    Raises:
        InputError: no estimate is possible for a sensor, not even from the others.
    """
    found = _stated_or_estimated(recording)
    if others:
        every = np.stack([found, *map(_stated_or_estimated, others)])
        known = np.maximum((every > 0).sum(axis=0), 1)
        found = np.sqrt(np.square(every).sum(axis=0) / known)
    reads = np.array([sensor.reads for sensor in recording.sensors])
    for index in np.flatnonzero(found == 0.0):
        alike = found[(reads == reads[index]) & (found > 0.0)]
        if not alike.size:
            problem = f"the noise of sensor {recording.names[index]!r} cannot be estimated"
            hint = "it is constant or has too few values: state its noise, recording.std={"
            hint += f"{recording.names[index]}: STD}}, or leave it out, "
            hint += f"recording.ignore=[{recording.names[index]}]"
            raise InputError(problem, hint=hint)
        found[index] = np.median(alike)
    return found


def _stated_or_estimated(recording: Recording) -> NDArray[np.float64]:
    """Return the stated or estimated std, ``(sensor,)``; 0 where nothing changes."""
    return np.array(
        [
            _estimated(recording.times, _noisy(sensor, values), recording.inputs)
            if sensor.std is None
            else sensor.std
            for sensor, values in zip(recording.sensors, recording.values.T, strict=True)
        ],
        dtype=np.float64,
    )


def _noisy(sensor: Sensor, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the readings of a sensor without those at its stops."""
    return np.where(values_at_stop(values), np.nan, values) if sensor.has_stops else values


def _estimated(
    times: NDArray[np.float64], values: NDArray[np.float64], inputs: InputSignals
) -> float:
    found = _from_differences(times, values)
    if inputs.values and is_fast(times, values):
        # Several upper bounds: the smallest is the nearest.
        found = min(found, predicted_noise(times, values, inputs))
    return found


def _from_differences(times: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    rough = _roughness(times, values)
    if len(rough) < MIN_DIFFERENCES:
        # With two loggers in one table, every second cell is empty: take differences across gaps.
        known = ~np.isnan(values)
        rough = _roughness(times[known], values[known])
    if not rough.size:
        return 0.0
    typical, least = float(np.median(rough)), ROUNDING * float(np.nanmax(np.abs(values)))
    if typical > least:
        return typical / NORMAL_MEDIAN_ABS / THIRD_DIFFERENCE_STD
    # Most readings are repeated. The mean square of the differences is not zero, but rounding to a
    # step leaves errors of at least step/√12, which change too slowly for the differences.
    steps = np.diff(np.unique(values[~np.isnan(values)]))
    step = float(steps[steps > least].min(initial=np.inf))
    if not math.isfinite(step):
        return 0.0
    return max(float(np.sqrt(np.mean(rough**2))) / THIRD_DIFFERENCE_STD, step / math.sqrt(12))


def _roughness(times: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``|Δ³y|`` where it is finite."""
    rough = _third_differences(times, values)
    return np.abs(rough[np.isfinite(rough)])


def _third_differences(
    times: NDArray[np.float64], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the third differences Δ³y, ``(time - 3,)``.

    Where steps are uneven, these are divided differences, scaled to the same noise: the weights
    ``w_i ∝ 1/Π_j (t_i - t_j)`` of four samples remove every quadratic.
    """
    rough: NDArray[np.float64] = np.diff(values, n=3)
    if len(values) < 4:
        return rough
    steps = sliding_window_view(np.diff(times), 3)
    uneven = np.ptp(steps, axis=1) > MAX_STEP_VARIATION * steps.mean(axis=1)
    four = sliding_window_view(times, 4)[uneven]
    apart = four[:, :, None] - four[:, None, :] + np.eye(4)
    # In units of the middle step: the powers of a tiny step would underflow.
    weights = 1 / np.prod(apart / (four[:, 2] - four[:, 1])[:, None, None], axis=2)
    weights *= THIRD_DIFFERENCE_STD / np.linalg.norm(weights, axis=1, keepdims=True)
    rough[uneven] = (weights * sliding_window_view(values, 4)[uneven]).sum(axis=1)
    return rough
