"""Sets of candidates on the linearised problem, from which the states are eliminated."""

from __future__ import annotations

from collections.abc import Sequence

from dashred.inference.fit.selection.subset_search import ProfiledProblem
from dashred.inference.segments.point import Point
from dashred.inference.segments.weak_constraint import WeakConstraintProblem

Set = tuple[int, ...]

# The largest set of the beam search, and how many of each size are extended.
LARGEST, BEAM = 4, 12


def profile(problem: WeakConstraintProblem, point: Point) -> ProfiledProblem | None:
    """Return F of all candidates, linearised about a point; None if a segment blows up.

    The uncertain parameters are eliminated like the states. The problem is in the coefficients
    themselves, not in their change.
    """
    normal = problem.linearise(point, range(problem.count))
    profiled = None if normal is None else normal.profiled(problem.count)
    if profiled is None:
        return None
    return ProfiledProblem.from_change(profiled, point.xi, problem.prior_std**-2)


def beam_search(profiled: ProfiledProblem, extended: Sequence[bool]) -> list[dict[Set, float]]:
    """Return the best sets of each size with their predicted F, the best first.

    Args:
        profiled: the linearised problem.
        extended: whether each candidate is beyond the library, ``(candidate,)``.
    """
    sizes: list[dict[Set, float]] = [{(): profiled.constant}]
    for _ in range(min(LARGEST, len(extended))):
        found = predict(profiled, with_one(list(sizes[-1]), extended))
        kept = sorted(found, key=found.__getitem__)[:BEAM]
        sizes.append({members: found[members] for members in kept})
    return sizes


def predict(profiled: ProfiledProblem, sets: Sequence[Set]) -> dict[Set, float]:
    """Return F of sets on the linearised problem."""
    costs = profiled.costs(sets).tolist() if sets else []
    return dict(zip(sets, costs, strict=True))


def with_one(sets: Sequence[Set], extended: Sequence[bool]) -> list[Set]:
    """Return the sets with one candidate more, but at most one beyond the library.

    Two functions beyond the library, such as a step and a smooth step, can make up for anything.

    Args:
        sets: indices of candidates.
        extended: whether each candidate is beyond the library, ``(candidate,)``.
    """
    grown = {
        tuple(sorted((*members, j)))
        for members in sets
        for j, is_extended in enumerate(extended)
        if j not in members and not (is_extended and any(extended[i] for i in members))
    }
    return sorted(grown)


def without_one(members: Set) -> list[Set]:
    """Return the sets with one candidate fewer, but for the empty one."""
    return [tuple(j for j in members if j != out) for out in members] if len(members) > 1 else []


def exchanged(members: Set, extended: Sequence[bool]) -> list[Set]:
    """Return the sets with one candidate in the place of another one."""
    return [s for s in with_one(without_one(members), extended) if s != members]
