"""Windows as sums of columns: cells, onsets and gates of every candidate.

Neighbouring cells make a box, also around a periodic axis. Two neighbouring onsets or gates make
one between them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor

from dashred.inference.fit.selection.subset_search import ProfiledProblem
from dashred.inference.forward.candidates import Candidate
from dashred.inference.hypotheses.windows.windowed_hypothesis import LOG_WIDTH, WindowGuess
from dashred.physics.expressions.semilinear import NotSemilinearError, SemilinearBuilder
from dashred.physics.grids.grid import Axis
from dashred.physics.system import System
from dashred.physics.window import Shape, Window, box, gate, onset

CELLS, TIMES = 12, 10
# Number of gate thresholds, evenly spaced between two quantiles of a field: a gate may lie between
# two wells, where there are few samples. Further thresholds lie at FAR_TAILS: a term that acts in
# one sample of a hundred can move a front.
THRESHOLDS, TAIL, FAR_TAILS = 9, 0.05, (0.005, 0.02)
# A far threshold is dropped if another one is closer than this share of the step.
MIN_DISTANCE = 0.25
# A box is at most this share of the axis long.
MAX_LENGTH = 0.75


@dataclass(frozen=True)
class WindowPiece:
    """An elementary window of one candidate. Sums of pieces make further windows.

    Attributes:
        candidate: index of the candidate.
        window: the window.
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


def build_pieces(
    system: System,
    candidates: Sequence[Candidate],
    windowed: Sequence[int],
    times: Tensor,
    states: Tensor,
) -> Iterator[WindowPiece]:
    """Yield the pieces of every pointwise candidate that may act in a window."""
    windows = [
        *(w for axis in system.axes for w in _build_cells(axis)),
        *_build_onsets(times),
        *_build_gates(system, states),
    ]
    for j in windowed:
        if _can_be_local(system, candidates[j]):
            yield from (WindowPiece(j, window) for window in windows)


def _build_cells(axis: Axis) -> list[Window]:
    width = axis.length / CELLS
    shape = box(axis)
    centres = [axis.begin + (j + 0.5) * width for j in range(CELLS)]
    return [shape.at((centre, width / 2, math.log(width / 4))) for centre in centres]


def _build_onsets(times: Tensor) -> list[Window]:
    edges = np.linspace(float(times.min()), float(times.max()), TIMES + 1)[1:-1]
    width = float(edges[1] - edges[0])
    return [onset().at((float(t), math.log(width / 8))) for t in edges]


def _build_gates(system: System, states: Tensor) -> list[Window]:
    gates = []
    for field, name in enumerate(system.fields):
        values = states[:, field].flatten()
        low, high = float(values.quantile(TAIL)), float(values.quantile(1 - TAIL))
        step = (high - low) / (THRESHOLDS + 1)
        thresholds = [low + step * (k + 1) for k in range(THRESHOLDS)]
        for share in (q for tail in FAR_TAILS for q in (tail, 1 - tail)):
            far = float(values.quantile(share))
            if min(abs(far - threshold) for threshold in thresholds) > MIN_DISTANCE * step:
                thresholds.append(far)
        width = math.log((high - low) / THRESHOLDS / 2)
        shape = gate(name, 1, system.reflection.value(name))
        gates += [shape.at((threshold, width)) for threshold in sorted(thresholds)]
    return gates


def combine_pieces(
    problem: ProfiledProblem, system: System, pieces: Sequence[WindowPiece], first: int
) -> Iterator[tuple[int, WindowGuess, dict[int, float]]]:
    """Yield candidate, first guess and weights of columns of every window that pieces make."""
    by_candidate: dict[int, dict[Shape, list[int]]] = {}
    for column, piece in enumerate(pieces, first):
        shapes = by_candidate.setdefault(piece.candidate, {})
        shapes.setdefault(piece.window.shape, []).append(column)
    values = {column: p.window.values for column, p in enumerate(pieces, first)}
    axes = {box(axis): axis for axis in system.axes}
    for j, shapes in by_candidate.items():
        for shape, columns in shapes.items():
            if shape in axes:
                yield from ((j, *run) for run in _combine_cells(shape, axes[shape], columns))
            else:
                edges = _combine_edges(problem, system, shape, columns, values, j)
                yield from ((j, *run) for run in edges)


def _combine_cells(
    shape: Shape, axis: Axis, columns: Sequence[int]
) -> Iterator[tuple[WindowGuess, dict[int, float]]]:
    """Yield every run of neighbouring cells, also around a periodic axis."""
    width = axis.length / CELLS
    for length in range(1, int(MAX_LENGTH * CELLS) + 1):
        for begin in range(CELLS if axis.periodic else CELLS - length + 1):
            chosen = [columns[(begin + k) % CELLS] for k in range(length)]
            centre = ((begin + length / 2) * width) % axis.length + axis.begin
            place = (centre, length * width / 2, math.log(width / 4))
            spread = (axis.length / 4, axis.length / 8, LOG_WIDTH)
            yield WindowGuess(shape, place, spread), dict.fromkeys(chosen, 1.0)


def _combine_edges(
    problem: ProfiledProblem,
    system: System,
    shape: Shape,
    columns: Sequence[int],
    values: dict[int, tuple[float, ...]],
    candidate: int,
) -> Iterator[tuple[WindowGuess, dict[int, float]]]:
    """Yield every onset, and every gate above or below a threshold.

    A gate below is the candidate minus the gate above. A weighted mean of two neighbours represents
    an edge between them; the weights are those that fit best.
    """
    places = [values[c][0] for c in columns]
    spread = ((max(places) - min(places)) / 2, LOG_WIDTH)
    sides: list[tuple[Shape, list[dict[int, float]]]] = [(shape, [{c: 1.0} for c in columns])]
    if shape.kind == "gate above":
        below = [{candidate: 1.0, c: -1.0} for c in columns]
        sides.append((gate(shape.of, -1, system.reflection.value(shape.of)), below))
    for side, weights in sides:
        edges = list(zip((values[c] for c in columns), weights, strict=True))
        for place, weight in edges:
            yield WindowGuess(side, place, spread), weight
        for (here, one), (there, other) in pairwise(edges):
            share = _best_share(problem, one, other)
            if share is not None:
                place = tuple((1 - share) * a + share * b for a, b in zip(here, there, strict=True))
                yield WindowGuess(side, place, spread), _blend(one, other, share)


def _best_share(
    problem: ProfiledProblem, one: dict[int, float], other: dict[int, float]
) -> float | None:
    """Return the second column's share of the best mean of two; None if one alone is best."""
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
