"""Forecast error of a law over segments: from the fitted states, over a few segments."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from dashred.inference.fit.forecast_choice import (
    FITTED_SHARE,
    MOST_TERMS,
    Forecast,
    forecast_of,
    needs_many_terms,
    smallest_sufficient,
)
from dashred.inference.forward.candidates import Candidate
from dashred.inference.segments.findings.error_growth import error_growth
from dashred.inference.segments.gauss_newton import fit_nodes
from dashred.inference.segments.segments import Array, Segments
from dashred.inference.segments.selection.search import SegmentSearch
from dashred.inference.segments.selection.set_selection import SegmentLaw

Indices = NDArray[np.intp]

# A forecast ends where an error of its start has grown by this factor: beyond, it says nothing
# about the law. It takes at most this share of the last part of an episode.
GROWTH, LONGEST_SHARE = 10.0, 0.5
STEPS = 8


def sufficient_law(search: SegmentSearch) -> SegmentLaw:
    """Return the smallest law whose forecast is about as good as the best of a few terms.

    If no law of a few terms forecasts the record, but the best law of all does, that one is
    returned: the simulator lacks many terms.
    """
    path: dict[int, SegmentLaw] = {}
    for law in sorted(search.laws, key=lambda each: each.fit.cost):
        path.setdefault(len(law.members), law)
    laws = [path[size] for size in sorted(path) if 0 < size <= MOST_TERMS]
    length = forecast_length(search)
    few = [forecast(search, law, length) for law in laws]
    without, best = (forecast(search, law, length) for law in (path[0], search.best))
    if needs_many_terms(without, few, best):
        return search.best
    return laws[smallest_sufficient(few)]


def forecast_length(search: SegmentSearch) -> int:
    """Return the number of segments of a forecast."""
    segments = search.problem.segments
    late = np.bincount(segments.episode[_last_part(segments)])
    longest = LONGEST_SHARE * float(late.max())
    rate = error_growth(search) / segments.count
    return max(1, int(min(longest, math.log(GROWTH) / rate if rate > 0 else math.inf)))


def forecast(search: SegmentSearch, law: SegmentLaw, length: int) -> Forecast:
    """Return the error of forecasts in the last part of every episode, in σ.

    The coefficients are fitted to the first part. The forecasts start from the fitted states.

    Args:
        search: gives the recording and its noise.
        law: a set of candidates and its fit.
        length: of a forecast, in segments.
    """
    problem, members = search.problem, list(law.members)
    segments = problem.segments
    late = _last_part(segments)
    early = replace(segments, readings=np.where(late[:, None, None], np.nan, segments.readings))
    first = replace(problem, simulator=problem.simulator.with_segments(early))
    point = fit_nodes(first, law.fit.point, members, STEPS).point
    candidates, xi = problem.changes(point, members)
    states, origin = law.fit.point.nodes, np.arange(segments.count)
    for _ in range(length):
        states, origin = _one_segment_on(search, states, origin, candidates, xi)
    ahead = problem.simulator.run(states, candidates, xi)
    apart = problem.read(ahead, point, members) - segments.readings
    # Only forecasts from within the last part count.
    counts = late & (origin >= 0) & late[origin]
    # After a blow-up the forecast is NaN.
    errors = np.where(np.isfinite(apart), apart / problem.noise_stds, np.inf)
    errors = np.where(np.isfinite(segments.readings), errors, np.nan)
    return forecast_of(torch.from_numpy(errors[counts].reshape(-1, errors.shape[-1])))


def _one_segment_on(
    search: SegmentSearch,
    states: Array,
    origin: Indices,
    candidates: Sequence[Candidate],
    xi: Array,
) -> tuple[Array, Indices]:
    """Forecast every state to the beginning of the next segment.

    Args:
        search: gives the segments.
        states: at the beginning of every segment, ``(segment, field)``.
        origin: segment in which the forecast of each began, ``(segment,)``; -1 without one.
        candidates: terms of the law.
        xi: their coefficients.
    """
    simulator = search.problem.simulator
    ends = simulator.run(states, candidates, xi)[:, -1]
    follows = simulator.segments.follows
    ahead, begun = states.copy(), np.full_like(origin, -1)
    ahead[1:][follows], begun[1:][follows] = ends[:-1][follows], origin[:-1][follows]
    return ahead, begun


def _last_part(segments: Segments) -> NDArray[np.bool_]:
    """Return which segments belong to the last part of their episode, ``(segment,)``."""
    late = np.zeros(segments.count, dtype=bool)
    for episode in range(len(segments.begins)):
        mine = np.flatnonzero(segments.episode == episode)
        late[mine[round(FITTED_SHARE * len(mine)) :]] = True
    return late
