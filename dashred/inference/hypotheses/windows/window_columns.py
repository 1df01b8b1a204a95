"""Windows as columns: cells, onsets and gates of every candidate, and how they are put together.

Cells make boxes, around a periodic axis too; two neighbouring edges make one between them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor

from dashred.inference.fit.subset_search import ProfiledProblem
from dashred.inference.forward.candidates import Candidate
from dashred.inference.hypotheses.windows.windowed_hypothesis import LOG_WIDTH, Guess
from dashred.physics.expressions.semilinear import NotSemilinearError, SemilinearBuilder
from dashred.physics.grids.grid import Axis
from dashred.physics.system import System
from dashred.physics.window import Shape, Window, box, gate, onset

CELLS, TIMES = 12, 10
# Thresholds of gates, even between these quantiles of a field: few samples lie between two wells,
# and yet a gate may. And at some farther out: what acts in one sample of a hundred moves a front.
THRESHOLDS, TAIL, FARTHER = 9, 0.05, (0.005, 0.02)
# Two that are closer than this share of the step are one.
CLOSE = 0.25
# A run of cells longer than this share of an axis is no region any more.
LONGEST = 0.75


@dataclass(frozen=True)
class Piece:
    """A part of a term's effect, of which windows are put together.

    Attributes:
        candidate: index of the candidate.
        window: where it acts.
    """

    candidate: int
    window: Window


def _can_be_local(system: System, candidate: Candidate) -> bool:
    """Tell whether a candidate is pointwise, so that a window can multiply it."""
    separator = SemilinearBuilder(frozenset(system.fields), tuple(a.name for a in system.axes))
    try:
        for term in candidate.terms:
            separator.pointwise(term.expression)
    except NotSemilinearError:
        return False
    return candidate.equation is not None


def pieces_of(
    system: System,
    candidates: Sequence[Candidate],
    windowed: Sequence[int],
    times: Tensor,
    states: Tensor,
) -> Iterator[Piece]:
    """Yield every part of a window that a pointwise candidate may act in."""
    windows = [
        *(w for axis in system.axes for w in _cells(axis)),
        *_periods(times),
        *_states(system, states),
    ]
    for j in windowed:
        if _can_be_local(system, candidates[j]):
            yield from (Piece(j, window) for window in windows)


def _cells(axis: Axis) -> list[Window]:
    width = axis.length / CELLS
    shape = box(axis)
    return [shape.at(((j + 0.5) * width, width / 2, math.log(width / 4))) for j in range(CELLS)]


def _periods(times: Tensor) -> list[Window]:
    edges = np.linspace(float(times.min()), float(times.max()), TIMES + 1)[1:-1]
    width = float(edges[1] - edges[0])
    return [onset().at((float(t), math.log(width / 8))) for t in edges]


def _states(system: System, states: Tensor) -> list[Window]:
    found = []
    for field, name in enumerate(system.fields):
        values = states[:, field].flatten()
        low, high = float(values.quantile(TAIL)), float(values.quantile(1 - TAIL))
        step = (high - low) / (THRESHOLDS + 1)
        thresholds = [low + step * (k + 1) for k in range(THRESHOLDS)]
        for share in (q for tail in FARTHER for q in (tail, 1 - tail)):
            far = float(values.quantile(share))
            if min(abs(far - threshold) for threshold in thresholds) > CLOSE * step:
                thresholds.append(far)
        width = math.log((high - low) / THRESHOLDS / 2)
        found += [gate(name, 1).at((threshold, width)) for threshold in sorted(thresholds)]
    return found


def windows_of(
    problem: ProfiledProblem, system: System, pieces: Sequence[Piece], first: int
) -> Iterator[tuple[int, Guess, dict[int, float]]]:
    """Yield candidate, guess and columns of every window that pieces make."""
    by_candidate: dict[int, dict[Shape, list[int]]] = {}
    for column, piece in enumerate(pieces, first):
        shapes = by_candidate.setdefault(piece.candidate, {})
        shapes.setdefault(piece.window.shape, []).append(column)
    values = {column: p.window.values for column, p in enumerate(pieces, first)}
    axes = {box(axis): axis for axis in system.axes}
    for j, shapes in by_candidate.items():
        for shape, columns in shapes.items():
            if shape in axes:
                yield from ((j, *run) for run in _runs(shape, axes[shape], columns))
            else:
                yield from ((j, *run) for run in _edges(problem, shape, columns, values, j))


def _runs(
    shape: Shape, axis: Axis, columns: Sequence[int]
) -> Iterator[tuple[Guess, dict[int, float]]]:
    """Yield every run of neighbouring cells, around a periodic axis too."""
    width = axis.length / CELLS
    for length in range(1, int(LONGEST * CELLS) + 1):
        for begin in range(CELLS if axis.periodic else CELLS - length + 1):
            chosen = [columns[(begin + k) % CELLS] for k in range(length)]
            centre = ((begin + length / 2) * width) % axis.length
            place = (centre, length * width / 2, math.log(width / 4))
            spread = (axis.length / 4, axis.length / 8, LOG_WIDTH)
            yield Guess(shape, place, spread), dict.fromkeys(chosen, 1.0)


def _edges(
    problem: ProfiledProblem,
    shape: Shape,
    columns: Sequence[int],
    values: dict[int, tuple[float, ...]],
    candidate: int,
) -> Iterator[tuple[Guess, dict[int, float]]]:
    """Yield every onset; every gate above, and below: what is not above, is below.

    A blend of two neighbours stands for an edge between them, as near to either as fits best.
    """
    places = [values[c][0] for c in columns]
    spread = ((max(places) - min(places)) / 2, LOG_WIDTH)
    sides: list[tuple[Shape, list[dict[int, float]]]] = [(shape, [{c: 1.0} for c in columns])]
    if shape.kind == "gate above":
        below = [{candidate: 1.0, c: -1.0} for c in columns]
        sides.append((gate(shape.of, -1), below))
    for side, weights in sides:
        edges = list(zip((values[c] for c in columns), weights, strict=True))
        for place, weight in edges:
            yield Guess(side, place, spread), weight
        for (here, one), (there, other) in pairwise(edges):
            share = _share(problem, one, other)
            if share is not None:
                place = tuple((1 - share) * a + share * b for a, b in zip(here, there, strict=True))
                yield Guess(side, place, spread), _blend(one, other, share)


def _share(
    problem: ProfiledProblem, one: dict[int, float], other: dict[int, float]
) -> float | None:
    """Return the second's share of the best blend of two columns; None where one alone is best."""
    index = sorted({*one, *other})
    weights = torch.tensor([[w.get(j, 0.0) for w in (one, other)] for j in index]).double()
    gram = weights.T @ problem.gram[index][:, index] @ weights
    goal = weights.T @ problem.target[index]
    scale = gram.diagonal().clamp(min=1e-300).sqrt()
    scaled = gram / scale[:, None] / scale + 1e-10 * torch.eye(2, dtype=torch.float64)
    first, second = (torch.linalg.solve(scaled, goal / scale) / scale).tolist()
    return second / (first + second) if first * second > 0 else None


def _blend(one: dict[int, float], other: dict[int, float], share: float) -> dict[int, float]:
    return {
        j: (1 - share) * one.get(j, 0.0) + share * other.get(j, 0.0) for j in sorted({*one, *other})
    }
