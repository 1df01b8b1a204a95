"""The error curve of a wandering sensor: a constant, and a random walk in time.

Over an episode of duration T the error is::

    b(t) = c + Σ_k e_k r_k(t)        r_k: 0 before knot k, 1 after knot k + 1, linear in between
    c ~ N(0, τ_c²)                   e_k ~ N(0, τ²/K)

so that it wanders by about τ over the episode. A straight drift has equal e_k. The constant is
shared by all episodes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from dashred.inference.fit.law import ErrorCurve
from dashred.inference.forward.episodes import without_padding
from dashred.inference.forward.sensor_block import OffsetErrors

# Largest number of segments of the curve in an episode, and fewest samples in one of them.
SEGMENTS, SEGMENT_SAMPLES = 16, 4
# Choices of τ: σ times powers of this, up to this many times the standard deviation of the trace.
LEVEL_RATIO, LARGEST_LEVEL = 3.0, 3.0
# The courses of an error in several episodes are compared at so many points, and are alike if their
# mean correlation is above this limit.
COMPARED, ALIKE = 20, 0.8
# Largest number of times at which a curve is reported.
REPORTED = 101


def curve_errors(
    times: Tensor, columns: list[int], sensors: int, trace_std: float, sigma: float
) -> list[OffsetErrors]:
    """Return the curves of one sensor, one for each choice of τ.

    Args:
        times: ``(time, episode)``.
        columns: columns of the sensor in the readings, one for each episode.
        sensors: number of all columns.
        trace_std: standard deviation of the trace, or of the noise if the trace is constant.
        sigma: standard deviation of the noise.
    """
    ramps = [_ramps(clock) for clock in times.T]
    patterns = torch.zeros((1 + sum(map(len, ramps)), len(times), sensors), dtype=torch.float64)
    patterns[0, :, columns] = 1.0
    steps, first = torch.zeros(len(patterns), dtype=torch.float64), 1
    for own, column in zip(ramps, columns, strict=True):
        own_patterns = slice(first, first + len(own))
        patterns[own_patterns, :, column] = own
        steps[own_patterns] = 1 / math.sqrt(len(own))
        first += len(own)
    constant = torch.zeros_like(steps)
    constant[0] = trace_std
    return [OffsetErrors(patterns, constant + level * steps) for level in _levels(trace_std, sigma)]


def error_curves(
    errors: OffsetErrors, times: Tensor, columns: list[int], amplitudes: Tensor, covariance: Tensor
) -> tuple[ErrorCurve, ...]:
    """Return the error of a sensor over time, in every episode.

    Args:
        errors: its curve.
        times: ``(time, episode)``.
        columns: columns of the sensor in the readings, one for each episode.
        amplitudes: the amplitudes of the curve, ``(amplitude,)``.
        covariance: their posterior covariance.
    """
    curves = []
    for episode, column in enumerate(columns):
        clock = without_padding(times[:, episode])
        count = min(len(clock), REPORTED)
        chosen = torch.linspace(0, len(clock) - 1, count).round().long()
        rows = errors.patterns[:, chosen, column].T
        stds = ((rows @ covariance) * rows).sum(dim=1).clamp(min=0).sqrt()
        value = rows @ amplitudes
        curves.append(
            ErrorCurve(
                tuple(clock[chosen].tolist()),
                tuple(value.tolist()),
                tuple(stds.tolist()),
                episode,
            )
        )
    return tuple(curves)


def follows_state(courses: Sequence[Sequence[float]]) -> bool:
    """Tell whether an error has the same course in all of several episodes.

    It then follows the state, and is no error of the sensor.

    Args:
        courses: the error over time in each episode.
    """
    if len(courses) < 2:
        return False
    share = np.linspace(0, 1, COMPARED)
    compared = [np.interp(share, np.linspace(0, 1, len(course)), course) for course in courses]
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = np.atleast_2d(np.corrcoef(compared))
    return bool(correlation[np.triu_indices(len(courses), 1)].mean() > ALIKE)


def _ramps(clock: Tensor) -> Tensor:
    """Return ``r_k(t)`` of one episode, ``(segment, time)``."""
    own = without_padding(clock)
    count = max(1, min(SEGMENTS, len(own) // SEGMENT_SAMPLES))
    duration = (own[-1] - own[0]).clamp(min=torch.finfo(clock.dtype).tiny)
    share = (clock - clock[0]) / duration * count
    knots = torch.arange(count, dtype=torch.float64)[:, None]
    return (share - knots).clamp(0.0, 1.0)


def _levels(trace_std: float, sigma: float) -> list[float]:
    largest = max(LARGEST_LEVEL * trace_std, sigma)
    count = 1 + math.floor(math.log(largest / sigma) / math.log(LEVEL_RATIO))
    return [sigma * LEVEL_RATIO**j for j in range(count)]
