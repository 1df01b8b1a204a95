"""Intervals in which the sampling was interrupted, as opposed to uneven by design."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Times = NDArray[np.float64]

# Of the intervals in order of length, one that is this many times the one before is not of the
# same sampling. In a design such as 0, 0.25, 0.5, 1, 2, 4, 8, 12, 24 each is at most four times it.
MAX_GROWTH = 5.0
# Two intervals are the same if their ends differ by at most this share of their length.
SAME = 0.1


def interruptions(times: Times, longest: float, others: Sequence[Times] = ()) -> NDArray[np.intp]:
    """Return the sample before every interruption, ``(interruption,)``.

    An interval is an interruption if it is longer than ``longest``, if no series of lengths, each
    at most five times the one before, leads to it, and if it is not part of a design: at least
    half of the other episodes have the same interval on their clocks.

    Args:
        times: of the samples of one episode, increasing, ``(time,)``.
        longest: length up to which an interval is usual.
        others: times of the other episodes, in the same form.
    """
    steps = np.diff(times)
    lengths = np.sort(steps)
    leaps = lengths[1:][(lengths[1:] > longest) & (lengths[1:] > MAX_GROWTH * lengths[:-1])]
    if not leaps.size:
        return np.zeros(0, dtype=np.intp)
    found = np.flatnonzero(steps >= leaps[0])
    planned = [_is_planned(times[first], times[first + 1], others) for first in found]
    return found[~np.array(planned)]


def _is_planned(begin: float, end: float, others: Sequence[Times]) -> bool:
    """Return whether at least half of the other episodes, and one at least, have an interval."""
    most = SAME * (end - begin)
    same = [
        bool(((np.abs(times[:-1] - begin) <= most) & (np.abs(times[1:] - end) <= most)).any())
        for times in others
    ]
    return any(same) and 2 * sum(same) >= len(same)
