"""Divide the intervals between the samples of all segments into steps."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from dashred.inference.segments.segments import Array, Segments
from dashred.physics.solvers.schedule import stops_between


def divided(segments: Segments, parts: int, jumps: Sequence[Array]) -> tuple[Array, Array]:
    """Return begin and length of every step, ``(step, segment)`` each.

    All intervals have the same number of steps. They are equal, unless an input jumps between two
    samples of any segment: then steps end at its jumps, and there are as many steps more.

    Args:
        segments: of the record.
        parts: steps from one sample to the next, without jumps.
        jumps: times at which the inputs of each episode jump, increasing, ``(jump,)``.
    """
    intervals = np.diff(segments.times, axis=1)
    stops = [
        [_stops(begin, end, parts, jumps[episode]) for begin, end in pairwise(times.tolist())]
        for times, episode in zip(segments.times, segments.episode, strict=True)
        if any(map(len, jumps))
    ]
    further = max((len(each) - 2 for row in stops for each in row), default=0)
    if not further:
        lengths = np.repeat(intervals, parts, axis=1) / parts
        shares = np.arange(parts) / parts
        begins = segments.times[:, :-1, None] + intervals[:, :, None] * shares
        return begins.reshape(segments.count, -1).T, lengths.T
    edges = np.array([[_edges(each, parts + further) for each in row] for row in stops])
    flat = edges[:, :, :-1].reshape(segments.count, -1)
    return flat.T, np.diff(edges, axis=2).reshape(segments.count, -1).T


def _stops(begin: float, end: float, parts: int, jumps: Array) -> list[float]:
    """Return the ends of an interval and the jumps inside; the clock may stand still."""
    return stops_between(begin, end, (end - begin) / parts, jumps) if end > begin else [begin, end]


def _edges(stops: Sequence[float], count: int) -> Array:
    """Return the ends of ``count`` steps that end at all stops, ``(1 + count,)``.

    The pieces between stops with the longest steps are divided further.
    """
    lengths, pieces = np.diff(stops), np.ones(len(stops) - 1, dtype=int)
    for _ in range(count - len(pieces)):
        pieces[np.argmax(lengths / pieces)] += 1
    parts = [np.linspace(a, b, n, False) for (a, b), n in zip(pairwise(stops), pieces, strict=True)]
    return np.append(np.concatenate(parts), stops[-1])
