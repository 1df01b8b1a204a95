"""Noise that depends on the reading: its size at every sample, relative to that of its sensor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dashred.core.stated.noise import NoiseLaw
from dashred.data.recording import Recording

Array = NDArray[np.float64]

# Neighbours on each side whose mean is the level of a reading.
NEIGHBOURS = 3


def noise_at(law: NoiseLaw, level: Array) -> Array:
    """Return ``σ = √(a² + (b y)² + c |y|)`` of readings at some levels y."""
    found: Array = np.sqrt(
        law.constant**2 + (law.relative * level) ** 2 + law.counts * np.abs(level)
    )
    return found


def relative_noise(
    recording: Recording, known: Array | float = 0.0, factors: Array | None = None
) -> Array | None:
    """Return ``σ(y)/σ`` of every reading, ``(time, sensor)``; None if σ is constant everywhere.

    σ(y) is the :class:`NoiseLaw` of the sensor at the level of the reading, and σ is its std. The
    level is the mean of the neighbouring readings. The reading itself is not used: readings that
    are low by chance would get a larger weight, and bias a fit.

    Args:
        recording: the readings.
        known: what was subtracted from them, ``(time, sensor)``.
        factors: σ of readings that have been divided, ``(time, sensor)``; None for 1.
    """
    if all(sensor.noise_law is None for sensor in recording.sensors):
        return factors
    levels = neighbour_mean(recording.values + known)
    found = np.ones_like(levels)
    for column, sensor in enumerate(recording.sensors):
        if sensor.noise_law is not None and sensor.std:
            found[:, column] = noise_at(sensor.noise_law, levels[:, column]) / sensor.std
    found = np.where(np.isfinite(found), found, 1.0)
    return found if factors is None else found * factors


def neighbour_mean(values: Array) -> Array:
    """Return the mean of the neighbours of every value, without the value itself.

    Args:
        values: ``(time, sensor)``; NaN where missing.

    Returns:
        ``(time, sensor)``; the value itself where it has no neighbours.
    """
    seen = np.isfinite(values)
    filled = np.where(seen, values, 0.0)
    total, count = np.zeros_like(filled), np.zeros_like(filled)
    for shift in range(1, min(NEIGHBOURS, len(values) - 1) + 1):
        for to, of in (
            (slice(shift, None), slice(None, -shift)),
            (slice(None, -shift), slice(shift, None)),
        ):
            total[to] += filled[of]
            count[to] += seen[of]
    return np.where(count > 0, total / np.maximum(count, 1), values)
