"""Which terms, and where: every term by cells, by times and by states, linearised, only algebra.

The columns are taken about a trajectory that a free forcing, or a law under one, has brought to the
recording, with forcing and law taken out: about the uncorrected trajectory a large mismatch
misleads (design §4.3.6).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor

from dashred.discovery.candidates import Candidate
from dashred.discovery.driven_shooting import DrivenShooting
from dashred.discovery.free_forcing import FreeForcing
from dashred.discovery.hypothesis import LOG_WIDTH, Guess, Hypothesis
from dashred.discovery.local_shooting import localised
from dashred.discovery.objective import Objective
from dashred.discovery.subsets import Eliminated
from dashred.physics.grid import Axis
from dashred.physics.linearisation import NotSeparableError, Separator
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


@dataclass(frozen=True)
class Screened:
    """A hypothesis as the linearised problem sees it.

    Attributes:
        hypothesis: candidates and window.
        cost: F, start and coefficients at their best.
        coefficients: these.
    """

    hypothesis: Hypothesis
    cost: float
    coefficients: tuple[float, ...]


def can_be_local(system: System, candidate: Candidate) -> bool:
    """Tell whether a candidate is pointwise, so that a window can multiply it."""
    separator = Separator(frozenset(system.fields), tuple(a.name for a in system.axes))
    try:
        for term in candidate.terms:
            separator.pointwise(term.expression)
    except NotSeparableError:
        return False
    return candidate.equation is not None


def screen(
    objective: Objective,
    everywhere: int,
    inside: Sequence[int],
    forced: FreeForcing,
    states: Tensor,
) -> list[Screened]:
    """Return single terms with every window, and every pair of terms everywhere.

    Args:
        objective: F of all candidates.
        everywhere: how many of these, the first, may act everywhere.
        inside: those that may act in a window.
        forced: a forcing that explains the recording.
        states: of its trajectory, ``(time, field, *grid)``: thresholds of gates lie among them.
    """
    system = objective.shooting.simulator.system
    candidates = objective.shooting.candidates
    pieces = list(_pieces(system, candidates, inside, objective.shooting.times, states))
    columns = [
        *candidates,
        *(localised([candidates[p.candidate]], p.window)[0] for p in pieces),
    ]
    stds = torch.cat([objective.prior_std, *[objective.prior_std[[p.candidate]] for p in pieces]])
    problem = eliminated(objective, forced, columns, stds)
    found = [_screened(problem, Hypothesis((j,)), {j: 1.0}) for j in range(everywhere)]
    pairs = [(i, j) for j in range(everywhere) for i in range(j)]
    costs = problem.costs(pairs).tolist() if pairs else []
    for pair, cost in zip(pairs, costs, strict=True):
        coefficients = tuple(problem.coefficients(pair).tolist())
        found.append(Screened(Hypothesis(pair), cost, coefficients))
    for j, guess, weights in _windows(system, pieces, len(candidates)):
        found.append(_screened(problem, Hypothesis((), (j,), guess), weights))
    return found


def eliminated(
    objective: Objective, forced: FreeForcing, columns: Sequence[Candidate], stds: Tensor
) -> Eliminated:
    """Linearise about the forced trajectory, and take out the forcing and the law under it.

    Args:
        objective: F of a law.
        forced: a forcing that explains the recording, on top of a law or of none.
        columns: candidates, in a window or not.
        stds: prior std of each one's coefficient.
    """
    driven = forced.objective.shooting
    assert isinstance(driven, DrivenShooting)
    modes = objective.modes
    law = replace(objective.shooting, candidates=(*columns, *driven.candidates))
    shooting = DrivenShooting.on(law, driven.pulses, driven.size)
    carrier = forced.objective.prior_std
    whole = replace(objective, shooting=shooting, prior_std=torch.cat([stds, carrier]))
    phi = forced.phi
    zero = torch.zeros(len(columns), dtype=torch.float64)
    at = torch.cat([phi[:modes], zero, phi[modes:]])
    normal = whole.linearise(at)
    target = normal.target
    kept = modes + len(columns)
    # F(φ) ≈ ‖J φ - b‖²: without the carrier's columns the law that is asked has to bear b.
    without = replace(
        normal,
        jacobian=normal.jacobian[:, :kept],
        precision=normal.precision[:kept],
        phi=torch.zeros(kept, dtype=torch.float64),
        residuals=-target,
    )
    return Eliminated.of(without, modes)


def _screened(problem: Eliminated, hypothesis: Hypothesis, weights: dict[int, float]) -> Screened:
    """Return the best coefficient of one sum of columns."""
    index = list(weights)
    w = torch.tensor([weights[j] for j in index], dtype=torch.float64)
    gram = float(w @ problem.gram[index][:, index] @ w)
    goal = float(w @ problem.target[index])
    precision = float(problem.precision[index[0]])
    return Screened(
        hypothesis, problem.constant - goal**2 / (gram + precision), (goal / (gram + precision),)
    )


def _pieces(
    system: System,
    candidates: Sequence[Candidate],
    inside: Sequence[int],
    times: Tensor,
    states: Tensor,
) -> Iterator[Piece]:
    windows = [
        *(w for axis in system.axes for w in _cells(axis)),
        *_periods(times),
        *_states(system, states),
    ]
    for j in inside:
        if can_be_local(system, candidates[j]):
            yield from (Piece(j, window) for window in windows)


def _cells(axis: Axis) -> list[Window]:
    width = axis.length / CELLS
    shape = box(axis)
    return [shape.at(((j + 0.5) * width, width / 2, math.log(width / 4))) for j in range(CELLS)]


def _periods(times: Tensor) -> list[Window]:
    edges = np.linspace(float(times[0]), float(times[-1]), TIMES + 1)[1:-1]
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


def _windows(
    system: System, pieces: Sequence[Piece], first: int
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
                yield from ((j, *run) for run in _edges(shape, columns, values, j))


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
    shape: Shape, columns: Sequence[int], values: dict[int, tuple[float, ...]], candidate: int
) -> Iterator[tuple[Guess, dict[int, float]]]:
    """Yield every onset; every gate above, and below: what is not above, is below.

    The mean of two neighbours stands for an edge between them.
    """
    places = [values[c][0] for c in columns]
    spread = (max(places) - min(places)) / 2
    single = [(values[c], {c: 1.0}) for c in columns]
    between = [(_middle(values[a], values[b]), {a: 0.5, b: 0.5}) for a, b in pairwise(columns)]
    for place, weights in (*single, *between):
        yield Guess(shape, place, (spread, LOG_WIDTH)), weights
        if shape.kind == "gate above":
            below = Guess(gate(shape.of, -1), place, (spread, LOG_WIDTH))
            yield below, {candidate: 1.0} | {c: -w for c, w in weights.items()}


def _middle(one: tuple[float, ...], other: tuple[float, ...]) -> tuple[float, ...]:
    return tuple((a + b) / 2 for a, b in zip(one, other, strict=True))
