"""The analysis of an ensemble square-root filter in compiled code, one reading after the other.

A sample of a stream has to take microseconds, and the first guess of a plane has many entries.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@numba.njit(cache=True)
def analyse(
    joint: Array, values: Array, noise: Array, tapers: Array, limits: Array
) -> tuple[Array, Array, Array, float]:
    """Assimilate the readings of one time, one after the other, and change ``joint`` in place.

    h are the anomalies of a reading and ``k = ρ ∘ cov(x, h) / (var h + σ²)`` is the gain. The mean
    changes by ``k (y − h̄)`` and the anomalies by ``−α k h`` with ``α = 1/(1 + √(σ²/(var h + σ²)))``
    (Whitaker & Hamill, Mon. Weather Rev. 130, 2002, eqs. 2 and 13).

    Args:
        joint: readings of each member, and then what is estimated from them, such as its state,
            ``(member, entry)``.
        values: readings, ``(sensor,)``; NaN is not assimilated.
        noise: σ of each sensor.
        tapers: localisation ρ, ``(sensor, entry)``.
        limits: a reading whose innovation is larger than this, in standard deviations, is not
            assimilated, ``(sensor,)``; 0 leaves a sensor out, and infinity is no limit.

    Returns:
        ``(sensor,)`` each: the innovations ``y − h̄`` before the analysis, their expected standard
        deviations, and the innovation of each reading given the readings before it, in its own
        standard deviations. Without localisation the last ones are independent and of unit variance
        if the model is right, also where the first ones are correlated. Then the logarithm of the
        density of the assimilated readings, without its constant.
    """
    members, entries = joint.shape
    sensors = len(values)
    mean = np.zeros(entries)
    for i in range(members):
        for e in range(entries):
            mean[e] += joint[i, e]
    for e in range(entries):
        mean[e] /= members
    for i in range(members):
        for e in range(entries):
            joint[i, e] -= mean[e]
    innovations, stds = np.empty(sensors), np.empty(sensors)
    serial = np.full(sensors, np.nan)
    for j in range(sensors):
        square = 0.0
        for i in range(members):
            square += joint[i, j] ** 2
        stds[j] = math.sqrt(square / (members - 1) + noise[j] ** 2)
        innovations[j] = values[j] - mean[j]
    h, gain = np.empty(members), np.empty(entries)
    density = 0.0
    for j in range(sensors):
        # This is also false for a missing reading.
        if not abs(innovations[j]) < limits[j] * stds[j]:
            continue
        square = 0.0
        for i in range(members):
            h[i] = joint[i, j]
            square += h[i] * h[i]
        error = noise[j] ** 2
        total = square / (members - 1) + error
        left = values[j] - mean[j]
        serial[j] = left / math.sqrt(total)
        density -= (left * left / total + math.log(total)) / 2
        gain[:] = 0.0
        for i in range(members):
            for e in range(entries):
                gain[e] += h[i] * joint[i, e]
        for e in range(entries):
            gain[e] *= tapers[j, e] / ((members - 1) * total)
            mean[e] += gain[e] * left
        alpha = 1 / (1 + math.sqrt(error / total))
        for i in range(members):
            for e in range(entries):
                joint[i, e] -= alpha * h[i] * gain[e]
    for i in range(members):
        for e in range(entries):
            joint[i, e] += mean[e]
    return innovations, stds, serial, density


@numba.njit(cache=True)
def inflate(members: Array, factor: float, random: Array) -> None:
    """Inflate the anomalies and add a random part to each member, without changing the mean.

    Args:
        members: states, ``(member, entry)``; they are changed in place.
        factor: on the anomalies.
        random: what is added to each member, ``(member, entry)``.
    """
    count, entries = members.shape
    for e in range(entries):
        mean, added = 0.0, 0.0
        for i in range(count):
            mean += members[i, e]
            added += random[i, e]
        mean, added = mean / count, added / count
        for i in range(count):
            members[i, e] = mean + factor * (members[i, e] - mean) + random[i, e] - added


def compile_analysis() -> None:
    """Compile :func:`analyse`, so that no later stage has to."""
    analyse(np.zeros((2, 2)), np.zeros(1), np.ones(1), np.ones((1, 2)), np.full(1, np.inf))
