"""How noisy each sensor is, where nobody said so."""

from __future__ import annotations

import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.data.recording import Recording

# Third differences of white noise of variance σ² have variance (1 + 9 + 9 + 1) σ².
SPREAD = math.sqrt(20.0)
# Steps that differ by more than this part are uneven: the clock of a logger is never exact.
UNEVEN = 0.01
# Median absolute value of a standard normal variable.
MEDIAN = 0.6744897501960817
# Of fewer differences the median says little.
ENOUGH = 20


def noise_std(recording: Recording, *others: Recording) -> NDArray[np.float64]:
    """Noise of each sensor, shape (sensor,), in its own unit.

    The stated std, or σ = median |Δ³y| / (0.6745 √20): third differences, divided ones where
    samples are unevenly apart, remove whatever is quadratic over four samples, and the median
    ignores the few that a front or a spike leaves. Where few samples follow each other without a
    gap, each sensor's own are taken across gaps.
    Of several episodes it is the rms of what those say in which the sensor changes at all. One in
    which nothing ever changes (stuck) gets the median of the others that read the same.

    Raises:
        InputError: if nothing can be estimated for a sensor, not even from the others.
    """
    found = _said_by(recording)
    if others:
        every = np.stack([found, *map(_said_by, others)])
        known = np.maximum((every > 0).sum(axis=0), 1)
        found = np.sqrt(np.square(every).sum(axis=0) / known)
    reads = np.array([sensor.reads for sensor in recording.sensors])
    for index in np.flatnonzero(found == 0.0):
        alike = found[(reads == reads[index]) & (found > 0.0)]
        if not alike.size:
            problem = f"the noise of sensor {recording.names[index]!r} cannot be estimated"
            hint = "it is constant or has too few values: state its std in the table of sensors"
            raise InputError(problem, hint=hint)
        found[index] = np.median(alike)
    return found


def _said_by(recording: Recording) -> NDArray[np.float64]:
    """Return the std that is stated or estimated, ``(sensor,)``; 0 where nothing changes."""
    return np.array(
        [
            _estimated(recording.times, values) if sensor.std is None else sensor.std
            for sensor, values in zip(recording.sensors, recording.values.T, strict=True)
        ],
        dtype=np.float64,
    )


def _estimated(times: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    rough = _roughness(times, values)
    if len(rough) < ENOUGH:
        # Across gaps: of two loggers in one table every second cell is empty.
        known = ~np.isnan(values)
        rough = _roughness(times[known], values[known])
    if not rough.size:
        return 0.0
    # Coarsely rounded values often repeat: the median is then zero, the mean square is not.
    typical = float(np.median(rough)) / MEDIAN or float(np.sqrt(np.mean(rough**2)))
    return typical / SPREAD


def _roughness(times: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``|Δ³y|`` where it is known."""
    rough = _third_differences(times, values)
    return np.abs(rough[np.isfinite(rough)])


def _third_differences(
    times: NDArray[np.float64], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return Δ³y, divided and scaled to the same noise where steps are uneven, ``(time - 3,)``.

    The weights ``w_i ∝ 1/Π_j (t_i - t_j)`` of four samples remove every quadratic.
    """
    rough: NDArray[np.float64] = np.diff(values, n=3)
    if len(values) < 4:
        return rough
    steps = sliding_window_view(np.diff(times), 3)
    uneven = np.ptp(steps, axis=1) > UNEVEN * steps.mean(axis=1)
    four = sliding_window_view(times, 4)[uneven]
    apart = four[:, :, None] - four[:, None, :] + np.eye(4)
    # In units of the middle step: the powers of a tiny one would be none.
    weights = 1 / np.prod(apart / (four[:, 2] - four[:, 1])[:, None, None], axis=2)
    weights *= SPREAD / np.linalg.norm(weights, axis=1, keepdims=True)
    rough[uneven] = (weights * sliding_window_view(values, 4)[uneven]).sum(axis=1)
    return rough
