"""Select sets of candidates: refit the promising ones through the simulator, until one stays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from dashred.core.budget import NEVER
from dashred.inference.fit.selection.subset_search import ProfiledProblem, backward_path
from dashred.inference.segments.gauss_newton import NodeFit, fit_nodes
from dashred.inference.segments.point import Point
from dashred.inference.segments.selection.candidate_sets import (
    LARGEST,
    Set,
    beam_search,
    exchanged,
    predict,
    profile,
    with_one,
    without_one,
)
from dashred.inference.segments.weak_constraint import WeakConstraintProblem

# A set is refitted under a model error that is larger by this factor first, because most candidates
# have been removed.
LOOSER = 10.0
LOOSER_STEPS, REFIT_STEPS, LOOSE_TOLERANCE = 4, 8, 0.01
# A set is refitted again if the linearisation about the winner predicts an F lower by this, in σ².
STUCK = 10.0
# How many sets are refitted in a round. Later rounds may add one candidate each to the winner of
# the round before, up to the last number.
REFITTED, ROUNDS, LARGEST_WINNER = 8, 8, 8
# Sets of up to so many candidates are reached by dropping one after the other from all of them.
LARGEST_LAW = 12
# About each of so many of the best laws, so many sets with one candidate exchanged or left out are
# refitted, if their predicted score is at most this much above that of the law.
NEAR, NEIGHBOURS, NEIGHBOUR_MARGIN = 3, 4, 10.0
# How many sets of each size up to the largest are refitted about a winner of more candidates.
SMALL_SETS = 3


@dataclass(frozen=True)
class SegmentLaw:
    """One set of candidates, refitted.

    Attributes:
        members: indices of its candidates, sorted.
        fit: the nodes and coefficients, and F.
        score: ``F/s² + k (ln n + 2 ln p)`` with s² the misfit of the best, lower is better.
    """

    members: Set
    fit: NodeFit
    score: float


def select(
    problem: WeakConstraintProblem,
    loose: WeakConstraintProblem,
    point: Point,
    proposals: Sequence[Set] = (),
) -> list[SegmentLaw]:
    """Refit promising sets about the winner of each round, until it stays; the best comes first.

    Args:
        problem: F under which the sets are refitted.
        loose: F under which the point was fitted, and about which the first round is linearised.
        point: a fit of all candidates.
        proposals: sets that are refitted in any case.
    """
    fits: dict[Set, NodeFit] = {}
    _refit_all(problem, point, [(), *proposals], fits)
    about, winner = loose, None
    for _ in range(ROUNDS):
        if problem.deadline.is_over:
            break
        profiled = profile(about, point)
        if profiled is None:
            break
        _refit_all(problem, point, _promising(problem, profiled, fits, winner or ()), fits)
        best = rank_laws(problem, fits)[0]
        # The fit of a smaller set may get stuck far from its minimum; the winner is near to it.
        while smaller := without_one(best.members):
            _refit_all(problem, best.fit.point, smaller, fits)
            before, best = best, rank_laws(problem, fits)[0]
            if best.members == before.members or problem.deadline.is_over:
                break
        if not math.isfinite(best.score) or best.members == winner:
            break
        point, about, winner = best.fit.point, problem, best.members
    drop_needless(problem, fits)
    best = rank_laws(problem, fits)[0]
    _refit_all(problem, best.fit.point, [(), *proposals], fits)
    if len(best.members) > LARGEST:
        refit_neighbours(problem, fits)
        refit_small_sets(problem, rank_laws(problem, fits)[0], fits)
    return rank_laws(problem, fits)


def drop_needless(problem: WeakConstraintProblem, fits: dict[Set, NodeFit]) -> None:
    """Refit the best set without the candidates that it does not need.

    It takes little time, so it is done after the deadline, too: a search that was ended early may
    have left candidates whose coefficients are below their error.

    Args:
        problem: F under which the sets are refitted.
        fits: sets and their fits, updated.
    """
    problem = replace(problem, deadline=NEVER)
    while smaller := without_one((best := rank_laws(problem, fits)[0]).members):
        profiled = profile(problem, best.fit.point)
        if profiled is None:
            break
        costs = predict(profiled, smaller)
        members = min(costs, key=costs.__getitem__)
        level = problem.level(fit.cost for fit in fits.values())
        if costs[members] > best.fit.cost + level * term_price(problem):
            break
        fit = refit(problem, best.fit.point, members)
        if members not in fits or fit.cost < fits[members].cost:
            fits[members] = fit
        if rank_laws(problem, fits)[0].members != members:
            break


def refit_neighbours(problem: WeakConstraintProblem, fits: dict[Set, NodeFit]) -> None:
    """Refit sets that differ from one of the best in one candidate, until these stay.

    Of many candidates several sets may fit about equally well. The sets of the search are near to
    one of them; these are near to the others. A candidate is exchanged or left out.

    Args:
        problem: F under which the sets are refitted.
        fits: sets and their fits, updated.
    """
    seen: set[Set] = set()
    while not problem.deadline.is_over:
        near = rank_laws(problem, fits)[:NEAR]
        law = next((each for each in near if each.members not in seen), None)
        if law is None:
            break
        seen.add(law.members)
        profiled = profile(problem, law.fit.point)
        if profiled is None:
            continue
        costs = predict(profiled, exchanged(law.members, problem.is_extended))
        costs |= predict(profiled, without_one(law.members))
        level, scores = _predicted_scores(problem, costs, fits)
        limit = law.fit.cost / level + term_price(problem) * len(law.members) + NEIGHBOUR_MARGIN
        best = sorted(scores, key=scores.__getitem__)[:NEIGHBOURS]
        sets = [members for members in best if members not in fits and scores[members] < limit]
        _refit_all(problem, law.fit.point, sets, fits)


def refit_small_sets(
    problem: WeakConstraintProblem, best: SegmentLaw, fits: dict[Set, NodeFit]
) -> None:
    """Refit promising sets of a few candidates, linearised about a law.

    Args:
        problem: F under which the sets are refitted.
        best: the law.
        fits: sets and their fits, updated.
    """
    profiled = profile(problem, best.fit.point)
    if profiled is None:
        return
    sizes = beam_search(profiled, problem.is_extended)[1:]
    small = [members for found in sizes for members in list(found)[:SMALL_SETS]]
    _refit_all(problem, best.fit.point, small, fits)


def _promising(
    problem: WeakConstraintProblem,
    profiled: ProfiledProblem,
    fits: dict[Set, NodeFit],
    winner: Set,
) -> list[Set]:
    """Return the sets with the best predicted scores, from a beam search and about the winner."""
    extended = problem.is_extended
    costs: dict[Set, float] = {}
    for found in beam_search(profiled, extended):
        costs |= found
    for members in backward_path(profiled, LARGEST_LAW):
        costs |= predict(profiled, [members])
    if len(winner) < LARGEST_WINNER:
        costs |= predict(profiled, with_one([winner], extended))
    level, scores = _predicted_scores(problem, costs, fits)
    ranked = sorted(scores, key=scores.__getitem__)[:REFITTED]
    return [s for s in ranked if s not in fits or costs[s] < fits[s].cost - STUCK * level]


def _predicted_scores(
    problem: WeakConstraintProblem, costs: dict[Set, float], fits: dict[Set, NodeFit]
) -> tuple[float, dict[Set, float]]:
    """Return s² of predicted and refitted sets, and the scores of the predicted ones."""
    level = problem.level([*costs.values(), *(fit.cost for fit in fits.values())])
    price = term_price(problem)
    return level, {members: cost / level + price * len(members) for members, cost in costs.items()}


def _refit_all(
    problem: WeakConstraintProblem, point: Point, sets: Sequence[Set], fits: dict[Set, NodeFit]
) -> None:
    """Refit sets from a point; an earlier, better fit stands."""
    for members in sets:
        if problem.deadline.is_over and fits:
            break
        fit = refit(problem, point, members)
        if members not in fits or fit.cost < fits[members].cost:
            fits[members] = fit


def refit(problem: WeakConstraintProblem, point: Point, members: Set) -> NodeFit:
    """Fit one set, under a looser model error first."""
    looser = problem.with_weights(LOOSER * problem.model_error, problem.prior_std)
    begun = fit_nodes(looser, point, members, LOOSER_STEPS, LOOSE_TOLERANCE)
    return fit_nodes(problem, begun.point, members, REFIT_STEPS)


def term_price(problem: WeakConstraintProblem) -> float:
    """Return the cost of one term more, ``ln n + 2 ln p``."""
    return math.log(problem.segments.seen) + 2 * math.log(max(problem.count, 1))


def rank_laws(problem: WeakConstraintProblem, fits: dict[Set, NodeFit]) -> list[SegmentLaw]:
    """Return refitted sets as laws, the best first.

    Args:
        problem: F under which the sets were refitted.
        fits: sets and their fits.
    """
    level = problem.level(fit.cost for fit in fits.values())
    price = term_price(problem)
    laws = [
        SegmentLaw(members, fit, fit.cost / level + price * len(members))
        for members, fit in fits.items()
    ]
    return sorted(laws, key=lambda law: law.score)
