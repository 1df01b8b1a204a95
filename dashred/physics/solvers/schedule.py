"""Time steps between output times."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dashred.physics.runge_kutta import INSIDE

Array = NDArray[np.float64]

# A jump closer to another stop than this share of the time step is no stop of its own.
APART = 1e-3
NO_JUMPS: Array = np.zeros(0)
# A ratio may exceed a whole number by this rounding error.
TOLERANCE = 1e-6


class Step(NamedTuple):
    """One step from ``t`` to ``t + h``.

    Attributes:
        begins, ends: whether the step starts or ends at an output time.
        first, last: times of the first and of the last stage: t and ``t + h``, or just inside if
            an input may jump at these times, so that each stage is on its own side of the jump.
    """

    t: float
    h: float
    begins: bool
    ends: bool
    first: float
    last: float


def schedule(times: Sequence[float], dt: float, jumps: Array = NO_JUMPS) -> Iterator[Step]:
    """Yield equal steps of at most ``dt`` between output times, and the jumps of inputs."""
    for begin, end in pairwise(times):
        stops = stops_between(begin, end, dt, jumps)
        for start, stop in pairwise(stops):
            count = max(1, round_up((stop - start) / dt))
            # Rounded: intervals equal up to rounding errors share the coefficients of a step.
            h = float(f"{(stop - start) / count:.12g}")
            inside = INSIDE * h if len(jumps) else 0.0
            for i in range(count):
                t = start + i * h
                begins = start == begin and i == 0
                ends = stop == end and i == count - 1
                yield Step(t, h, begins, ends, t + inside, t + h - inside)


def count_steps(times: Sequence[float], dt: float) -> int:
    """Return the number of steps of a schedule, without those that jumps of inputs add.

    A time step that is NaN, as for adaptive methods, counts one step between output times.
    """
    if math.isnan(dt):
        return len(times) - 1
    return int(np.maximum(1, np.ceil(np.diff(times) / dt - TOLERANCE)).sum())


def stops_between(begin: float, end: float, dt: float, jumps: Array) -> list[float]:
    """Return the ends of an interval, and the jumps between them.

    Args:
        begin: of the interval.
        end: of the interval.
        dt: largest time step.
        jumps: times at which an input jumps, increasing, ``(jump,)``.
    """
    if not len(jumps):
        return [begin, end]
    apart = APART * min(dt, end - begin)
    between = np.searchsorted(jumps, [begin + apart, end - apart])
    stops = [begin]
    for jump in jumps[slice(*between)].tolist():
        if jump > stops[-1] + apart:
            stops.append(jump)
    return [*stops, end]


def round_up(ratio: float) -> int:
    """Round up to a whole number of steps, tolerating rounding errors: 15.0000001 → 15."""
    return int(-(-(ratio - TOLERANCE) // 1))
