"""Find the law over segments: anneal the model error, then select sets of candidates.

1. The state alone, under a loose model error.
2. All candidates with a ridge, while the model error shrinks.
3. Sets of candidates by beam search on the profiled problem, the best of them refitted; and again
   about the winner, until it stays.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from dashred.inference.fit.subset_search import ProfiledProblem
from dashred.inference.forward.candidates import Candidate
from dashred.inference.segments.gauss_newton import NodeFit, fit_nodes
from dashred.inference.segments.natural_scales import NaturalScales
from dashred.inference.segments.weak_constraint import Point, WeakConstraintProblem

Set = tuple[int, ...]

# Model error q, in units of rate · duration of a segment, and the prior of the coefficients, in
# units of their natural scales.
STATE_ALONE = (0.3, 0.1, 0.05)
ALL_TERMS = ((0.1, 0.1), (0.03, 0.2), (0.01, 0.3))
SELECTION, PRIOR = 0.003, 0.3
# A set is refitted under a larger model error first, because most candidates have been removed.
LOOSER = 0.03
# Expected misfit per reading of all candidates together. If the misfit is far smaller, the noise
# was overestimated.
EXPECTED, OVERESTIMATED, LEAST, NOISE_ROUNDS = 0.5, 0.15, 1e-6, 3
ANNEALING_STEPS, LOOSER_STEPS, REFIT_STEPS = 6, 4, 8
LOOSE_TOLERANCE = 0.01
# A set is refitted again if the linearisation about the winner predicts an F lower by this, in σ².
STUCK = 10.0
# The largest set, how many of each size are extended, and how many are refitted in a round.
LARGEST, BEAM, REFITTED, ROUNDS = 4, 12, 8, 4


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


@dataclass(frozen=True)
class SegmentSearch:
    """The result of a search.

    Attributes:
        problem: F as the sets were refitted.
        natural: scales.
        laws: every set, the best first.
    """

    problem: WeakConstraintProblem
    natural: NaturalScales
    laws: list[SegmentLaw]

    @property
    def level(self) -> float:
        """Misfit per reading of the best law: the ratio of estimated to assumed σ²."""
        return max(self.best.fit.cost / self.problem.segments.seen, 1e-12)

    def terms(self, law: SegmentLaw) -> tuple[tuple[Candidate, ...], np.ndarray]:
        """Return the candidates of a law and their coefficients, ``(candidate,)``."""
        members = list(law.members)
        return tuple(self.problem.candidates[j] for j in members), law.fit.point.xi[members]

    def states(self, law: SegmentLaw) -> np.ndarray:
        """Return the states of a law in every segment, ``(segment, sample, field)``."""
        return self.problem.simulator.run(law.fit.point.nodes, *self.terms(law))

    @property
    def best(self) -> SegmentLaw:
        """The set with the lowest score."""
        return self.laws[0]


def search(
    problem: WeakConstraintProblem, guesses: Sequence[np.ndarray], natural: NaturalScales
) -> SegmentSearch:
    """Return the laws that explain the record.

    Args:
        problem: F with its noise and starts; q and d are set here.
        guesses: first guesses of the nodes, ``(segment, field)`` each.
        natural: scales.
    """
    everything = tuple(range(len(problem.candidates)))
    states = [_state_alone(problem, nodes, natural) for nodes in guesses]
    point = min(states, key=lambda fit: fit.cost).point
    for _ in range(NOISE_ROUNDS):
        for q, prior in ALL_TERMS:
            weighted = _weighted(problem, natural, q, prior)
            fit = fit_nodes(weighted, point, everything, ANNEALING_STEPS)
            point = fit.point
        left = fit.cost / problem.segments.seen
        if left > OVERESTIMATED:
            break
        # Differences of readings overestimate σ where the samples are few in a period.
        factor = math.sqrt(max(left, LEAST) / EXPECTED)
        problem = problem.with_noise(factor * problem.noise_std)
    tight = _weighted(problem, natural, SELECTION, PRIOR)
    return SegmentSearch(tight, natural, _select(tight, weighted, point))


def _state_alone(
    problem: WeakConstraintProblem, nodes: np.ndarray, natural: NaturalScales
) -> NodeFit:
    """Fit the nodes under the simulator as it is, with a model error that shrinks."""
    fit = NodeFit(Point(nodes, np.zeros(len(problem.candidates))), math.inf)
    for q in STATE_ALONE:
        fit = fit_nodes(_weighted(problem, natural, q, 1.0), fit.point, (), ANNEALING_STEPS)
    return fit


def _weighted(
    problem: WeakConstraintProblem, natural: NaturalScales, q: float, prior: float
) -> WeakConstraintProblem:
    error = np.maximum(q * natural.rate * problem.segments.span, 1e-4 * natural.size)
    return problem.with_weights(error, prior * natural.coefficient)


def _select(
    problem: WeakConstraintProblem, loose: WeakConstraintProblem, point: Point
) -> list[SegmentLaw]:
    """Refit promising sets about the winner of each round, until it stays."""
    fits: dict[Set, NodeFit] = {(): _refit(problem, point, ())}
    everything, seen = range(len(problem.candidates)), problem.segments.seen
    about, winner = loose, None
    for _ in range(ROUNDS):
        if problem.deadline.is_over:
            break
        normal = about.linearise(point, everything)
        profiled = None if normal is None else normal.profiled()
        if profiled is None:
            break
        sets = _promising(_in_coefficients(profiled, point.xi, about.prior_std), fits, seen)
        _refit_all(problem, point, sets, fits)
        best = _ranked(problem, fits)[0]
        # The fit of a smaller set may get stuck far from its minimum; the winner is near to it.
        while smaller := _without_one(best.members):
            _refit_all(problem, best.fit.point, smaller, fits)
            before, best = best, _ranked(problem, fits)[0]
            if best.members == before.members or problem.deadline.is_over:
                break
        if not math.isfinite(best.score) or best.members == winner:
            break
        point, about, winner = best.fit.point, problem, best.members
    return _ranked(problem, fits)


def _refit_all(
    problem: WeakConstraintProblem, point: Point, sets: Sequence[Set], fits: dict[Set, NodeFit]
) -> None:
    """Refit sets from a point; an earlier, better fit stands."""
    for members in sets:
        if problem.deadline.is_over:
            break
        fit = _refit(problem, point, members)
        if members not in fits or fit.cost < fits[members].cost:
            fits[members] = fit


def _without_one(members: Set) -> list[Set]:
    """Return the sets with one candidate fewer, but for the empty one."""
    return [tuple(j for j in members if j != out) for out in members] if len(members) > 1 else []


def _refit(problem: WeakConstraintProblem, point: Point, members: Set) -> NodeFit:
    """Fit one set, under a looser model error first."""
    looser = problem.with_weights(LOOSER / SELECTION * problem.model_error, problem.prior_std)
    begun = fit_nodes(looser, point, members, LOOSER_STEPS, LOOSE_TOLERANCE)
    return fit_nodes(problem, begun.point, members, REFIT_STEPS)


def _in_coefficients(
    profiled: tuple[np.ndarray, np.ndarray, float], xi: np.ndarray, prior_std: np.ndarray
) -> ProfiledProblem:
    """Return the profiled problem in ξ itself, not in its change."""
    gram, target, cost = profiled
    shifted = target + gram @ xi
    constant = cost + float(2 * target @ xi + xi @ gram @ xi)
    precision = prior_std**-2
    return ProfiledProblem(
        torch.from_numpy(gram - np.diag(precision)),
        torch.from_numpy(shifted),
        constant,
        torch.from_numpy(precision),
    )


def _promising(profiled: ProfiledProblem, fits: dict[Set, NodeFit], seen: int) -> list[Set]:
    """Return the sets with the best predicted scores."""
    level = _level((fit.cost for fit in fits.values()), seen)
    price = _price(len(profiled.target), seen)
    costs: dict[Set, float] = {(): profiled.constant}
    kept: list[Set] = [()]
    for _ in range(min(LARGEST, len(profiled.target))):
        grown = {
            tuple(sorted((*members, j)))
            for members in kept
            for j in range(len(profiled.target))
            if j not in members
        }
        sets = sorted(grown)
        found = dict(zip(sets, profiled.costs(sets).tolist(), strict=True))
        kept = sorted(sets, key=found.__getitem__)[:BEAM]
        costs |= {members: found[members] for members in kept}
    level = min(level, min(costs.values()) / seen)
    ranked = sorted(costs, key=lambda s: costs[s] / level + price * len(s))[:REFITTED]
    return [s for s in ranked if s not in fits or costs[s] < fits[s].cost - STUCK * level]


def _ranked(problem: WeakConstraintProblem, fits: dict[Set, NodeFit]) -> list[SegmentLaw]:
    seen = problem.segments.seen
    level = _level((fit.cost for fit in fits.values()), seen)
    price = _price(len(problem.candidates), seen)
    laws = [
        SegmentLaw(members, fit, fit.cost / level + price * len(members))
        for members, fit in fits.items()
    ]
    return sorted(laws, key=lambda law: law.score)


def _level(costs: Iterator[float], seen: int) -> float:
    """Return the misfit per reading of the best fit: the ratio of estimated to assumed σ²."""
    return min(costs, default=math.inf) / seen


def _price(candidates: int, seen: int) -> float:
    """Return the cost of one candidate more, ``ln n + 2 ln p``."""
    return math.log(seen) + 2 * math.log(max(candidates, 1))
