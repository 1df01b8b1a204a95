"""Which sets of candidates to refit: promising ones, and those one move away from the best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dashred.inference.fit.subset_search import ProfiledProblem, backward_path, small_sets

Set = tuple[int, ...]

LARGEST = 3
LARGEST_ON_PATH = 6
# Sets refitted at first, by size; the backward path and the proposals come on top.
REFITTED = {1: 6, 2: 8, 3: 8}
NEIGHBOURS = 16
# A fit that the linearisation about a better one undercuts by this has got stuck.
STUCK = 2.0


def promising(problem: ProfiledProblem) -> list[Set]:
    """Return the best sets of each size, and those of the backward path."""
    count = len(problem.target)
    found: list[Set] = []
    for sets in small_sets(count, min(LARGEST, count)):
        size = len(sets[0])
        if size:
            order = problem.costs(sets).argsort()[: REFITTED[size]]
            found += [sets[i] for i in order.tolist()]
    path = backward_path(problem, LARGEST_ON_PATH)
    return found + [members for members in path if len(members) > LARGEST]


def neighbours(problem: ProfiledProblem, members: Set, tried: Mapping[Set, float]) -> list[Set]:
    """Return the best sets that one swap, one addition or one omission makes of a set.

    And small ones that are promising from here. A set that was tried before stays out, unless
    its fit falls short of what the linearisation promises: from afar a fit may have got stuck.

    Args:
        problem: linearised about the set's fit.
        members: the set.
        tried: F of the sets that were refitted.
    """
    others = [j for j in range(len(problem.target)) if j not in members]
    drops = [tuple(j for j in members if j != out) for out in members]
    swaps = [tuple(sorted((*kept, other))) for kept in drops for other in others]
    adds = [tuple(sorted((*members, other))) for other in others]
    found: list[Set] = _unreached(problem, promising(problem), tried)
    for moves, most in ((drops, len(drops)), (swaps, NEIGHBOURS // 2), (adds, NEIGHBOURS // 2)):
        if moves:
            order = problem.costs(moves).argsort().tolist()
            found += _unreached(problem, [moves[i] for i in order], tried)[:most]
    return found


def _unreached(
    problem: ProfiledProblem, sets: Sequence[Set], tried: Mapping[Set, float]
) -> list[Set]:
    """Return the sets that were not tried, or whose fit falls short of the linearised one."""
    return [
        members
        for members in sets
        if members not in tried or float(problem.costs([members])) < tried[members] - STUCK
    ]
