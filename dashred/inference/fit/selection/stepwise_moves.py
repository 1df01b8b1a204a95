"""The sets of candidates to refit: promising sets, and sets one move away from the best."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from torch import Tensor

from dashred.inference.fit.normal_equations import solve
from dashred.inference.fit.selection.best_subsets import best_subsets
from dashred.inference.fit.selection.subset_search import ProfiledProblem, backward_path

Set = tuple[int, ...]

LARGEST = 3
LARGEST_ON_PATH = 6
# Number of sets refitted at first, by size, in addition to the backward path and the proposals.
REFITTED = {1: 6, 2: 8, 3: 8}
NEIGHBOURS = 16
# A fit is stuck if the linearised problem predicts an F that is lower by more than this.
STUCK = 2.0
# Effects with a larger cosine of their angle are nearly the same; so many are tried for each term.
ALIKE, MOST_ALIKE = 0.98, 4
# Nothing of an effect is left if less than this share of its square is.
LEAST_LEFT = 1e-6


def promising_sets(problem: ProfiledProblem) -> list[Set]:
    """Return the best sets of each size, and those of the backward path."""
    count = len(problem.target)
    found: list[Set] = []
    for size, most in REFITTED.items():
        if size <= count:
            found += [tuple(members) for members in best_subsets(problem, size, most).tolist()]
    path = backward_path(problem, LARGEST_ON_PATH)
    return found + [members for members in path if len(members) > LARGEST]


def neighbouring_sets(
    problem: ProfiledProblem, first: ProfiledProblem, members: Set, tried: Mapping[Set, float]
) -> list[Set]:
    """Return the best sets that differ from a set by one swap, one addition or one omission.

    The small promising sets are included, and :func:`exchanges`. A set that was refitted before is
    left out, unless its F is above the prediction of the linearised problem: its fit may be stuck.

    Args:
        problem: the linearised problem at the fit of the set.
        first: the problem as it was linearised first.
        members: the set.
        tried: F of the sets that were refitted.
    """
    others = [j for j in range(len(problem.target)) if j not in members]
    drops = [tuple(j for j in members if j != out) for out in members]
    swaps = [tuple(sorted((*kept, other))) for kept in drops for other in others]
    adds = [tuple(sorted((*members, other))) for other in others]
    found = _to_refit(problem, [*promising_sets(problem), *exchanges(first, members)], tried)
    for moves, most in ((drops, len(drops)), (swaps, NEIGHBOURS // 2), (adds, NEIGHBOURS // 2)):
        if moves:
            order = problem.costs(moves).argsort().tolist()
            found += _to_refit(problem, [moves[i] for i in order], tried)[:most]
    return found


def exchanges(problem: ProfiledProblem, members: Set) -> list[Set]:
    """Return the sets with one member exchanged for a candidate of nearly the same effect.

    Where the problem is linearised first, a true term may have the same effect as a wrong one: two
    fields are equal, or a swing is small. Once a law has moved the states, they differ.

    Args:
        problem: the problem as it was linearised first.
        members: the set.
    """
    found = []
    for out in members:
        kept = [j for j in members if j != out]
        cosines = _cosines(problem, out, kept)
        cosines[list(members)] = 0.0
        order = cosines.argsort(descending=True)[:MOST_ALIKE].tolist()
        found += [tuple(sorted((*kept, other))) for other in order if cosines[other] > ALIKE]
    return found


def _cosines(problem: ProfiledProblem, candidate: int, kept: Sequence[int]) -> Tensor:
    """Return the cosines of effects to that of one candidate, less what others can imitate."""
    kept, gram, size = list(kept), problem.gram, problem.gram.diagonal()
    left = gram - gram[:, kept] @ solve(gram[kept][:, kept], gram[kept])
    square = left.diagonal().where(left.diagonal() > LEAST_LEFT * size, math.inf)
    return left[candidate].abs() / (square * square[candidate]).sqrt()


def _to_refit(
    problem: ProfiledProblem, sets: Sequence[Set], tried: Mapping[Set, float]
) -> list[Set]:
    """Return the sets that were not refitted, or whose F is above the prediction."""
    return [
        members
        for members in sets
        if members not in tried or float(problem.costs([members])) < tried[members] - STUCK
    ]
