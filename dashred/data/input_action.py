"""How a sampled input acts between samples and after a delay."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Time of a jump, as a share of the shortest step between samples: shorter than the distance of the
# stages of a Runge–Kutta step from its ends.
JUMP = 1e-9


def act(times: Array, values: Array, hold: bool, delay: float) -> tuple[Array, Array]:
    """Return the knots of the piecewise linear curve by which an input acts.

    A held input jumps at its samples: the curve is a steep line that ends at the sample.

    Args:
        times: of the samples, increasing, ``(sample,)``.
        values: ``(sample,)``.
        hold: whether a sample holds until the next one.
        delay: time after which a sample acts, at least 0.

    Returns:
        Times and values of the knots, over the time of the samples. Without hold and delay, the
        arrays that were given.
    """
    if len(times) < 2 or not (hold or delay):
        return times, values
    knots, levels = _steps(times, values) if hold else (times, values)
    if delay:
        first, last = times[0], times[-1]
        kept = knots + delay < last
        end = np.interp(last - delay, knots, levels)
        knots = np.concatenate([[first], knots[kept] + delay, [last]])
        levels = np.concatenate([levels[:1], levels[kept], [end]])
    return knots, levels


def jump_times(times: Array, values: Array, delay: float) -> Array:
    """Return the times at which a held input jumps, ``(jump,)``.

    Args:
        times: of the samples, increasing, ``(sample,)``.
        values: ``(sample,)``.
        delay: time after which a sample acts, at least 0.
    """
    at = times[_jumps(values)] + delay
    return at[at < times[-1]] if delay else at


def fill_gaps(times: Array, values: Array, hold: bool) -> Array:
    """Return the values of an input at all times, where some are missing (NaN).

    Args:
        times: of the samples, increasing, ``(sample,)``.
        values: ``(sample,)``; at least one is known.
        hold: whether a value holds until the next one; else they are joined by straight lines.

    Returns:
        ``(sample,)``; NaN before the first known value, and after the last one unless it holds.
    """
    known = np.flatnonzero(~np.isnan(values))
    if not hold:
        return np.interp(times, times[known], values[known], left=np.nan, right=np.nan)
    latest = np.searchsorted(known, np.arange(len(values)), side="right") - 1
    return np.where(latest >= 0, values[known[latest]], np.nan)


def _steps(times: Array, values: Array) -> tuple[Array, Array]:
    """Return the knots of a staircase; only samples with a new value are jumps."""
    resolution = float(np.spacing(np.abs(times).max()))
    width = max(JUMP * float(np.diff(times).min()), 4 * resolution)
    jumps = _jumps(values)
    at, before, after = times[jumps], values[jumps - 1], values[jumps]
    inner = np.column_stack([at - width, at]).ravel()
    levels = np.column_stack([before, after]).ravel()
    if not len(jumps) or jumps[-1] < len(times) - 1:
        inner, levels = np.append(inner, times[-1]), np.append(levels, values[-1])
    return np.append(times[:1], inner), np.append(values[:1], levels)


def _jumps(values: Array) -> NDArray[np.intp]:
    """Return the samples whose value is not that of the sample before."""
    return np.flatnonzero(values[1:] != values[:-1]) + 1
