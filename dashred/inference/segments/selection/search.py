"""Find the law over segments: anneal the model error, then select sets of candidates.

1. The state alone, under a loose model error.
2. All candidates with a ridge, while the model error shrinks.
3. Sets of candidates by beam search on the profiled problem, the best of them refitted; and again
   about the winner, until it stays.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dashred.inference.forward.candidates import Candidate
from dashred.inference.segments.gauss_newton import NodeFit, fit_nodes
from dashred.inference.segments.natural_scales import NaturalScales
from dashred.inference.segments.point import Point
from dashred.inference.segments.selection.causes import Cause, Level
from dashred.inference.segments.selection.set_selection import (
    REFITTED,
    SegmentLaw,
    rank_laws,
    select,
)
from dashred.inference.segments.selection.walk_choice import Walking
from dashred.inference.segments.weak_constraint import WeakConstraintProblem

# Model error q, in units of rate · duration of a segment, and the prior of the coefficients, in
# units of their natural scales.
STATE_ALONE = (0.3, 0.1, 0.05)
ALL_TERMS = ((0.1, 0.1), (0.03, 0.2), (0.01, 0.3))
SELECTION, PRIOR = 0.003, 3.0
# Expected misfit per reading of all candidates together. If the misfit is far smaller, the noise
# was overestimated.
EXPECTED, OVERESTIMATED, NOISE_ROUNDS = 0.5, 0.15, 3
ANNEALING_STEPS = 6


@dataclass(frozen=True)
class SegmentSearch:
    """The result of a search.

    Attributes:
        problem: F as the sets were refitted, with the walks of sensor errors, if any.
        natural: scales.
        laws: every set, the best first.
        errors: the sensor errors, with their levels.
        price: of the sensor errors, see :class:`Walking`.
    """

    problem: WeakConstraintProblem
    natural: NaturalScales
    laws: list[SegmentLaw]
    errors: Mapping[Cause, Level] = field(default_factory=dict)
    price: float = 0.0

    @property
    def level(self) -> float:
        """Misfit per reading of the best law: the ratio of estimated to assumed σ²."""
        return self.problem.level([self.best.fit.cost])

    def terms(self, law: SegmentLaw) -> tuple[tuple[Candidate, ...], np.ndarray]:
        """Return the candidates of a law and their coefficients, ``(candidate,)``."""
        return self.problem.terms(law.fit.point, law.members)

    def states(self, law: SegmentLaw) -> np.ndarray:
        """Return the states of a law in every segment, ``(segment, sample, field)``."""
        return self.problem.states(law.fit.point, law.members)

    def with_best(self, law: SegmentLaw) -> SegmentSearch:
        """Return the search with another law in the first place, instead of larger ones."""
        others = [
            other
            for other in self.laws
            if other is not law and len(other.members) <= len(law.members)
        ]
        told = replace(law, score=min(self.best.score, law.score))
        return replace(self, laws=[told, *others])

    def walking(self, law: SegmentLaw) -> Walking:
        """Return a law with the sensor errors beside it."""
        return Walking(self.problem, law.members, law.fit, self.price, self.errors)

    @property
    def best(self) -> SegmentLaw:
        """The set with the lowest score."""
        return self.laws[0]


def search(
    problem: WeakConstraintProblem,
    guesses: Sequence[np.ndarray],
    natural: NaturalScales,
) -> SegmentSearch:
    """Return the laws that explain the record.

    Args:
        problem: F with its noise and starts; q and d are set here.
        guesses: first guesses of the nodes, ``(segment, field)`` each.
        natural: scales.
    """
    everything = tuple(range(problem.count))
    states = [_state_alone(problem, nodes, natural) for nodes in guesses]
    point = min(states, key=lambda fit: fit.cost).point
    for _ in range(NOISE_ROUNDS):
        for q, prior in ALL_TERMS:
            loose = weighted(problem, natural, q, prior)
            fit = fit_nodes(loose, point, everything, ANNEALING_STEPS)
            point = fit.point
        left = fit.cost / problem.segments.seen
        if left > OVERESTIMATED:
            break
        # Differences of readings overestimate σ where the samples are few in a period.
        factor = math.sqrt(problem.level([fit.cost]) / EXPECTED)
        problem = problem.with_noise(factor * problem.noise_std)
    tight = weighted(problem, natural, SELECTION, PRIOR)
    return SegmentSearch(tight, natural, select(tight, loose, point))


def search_further(
    found: SegmentSearch, candidates: Sequence[Candidate], scales: np.ndarray
) -> SegmentSearch:
    """Return the laws of more candidates, selected about the best law of a search.

    Args:
        found: the earlier search.
        candidates: further candidates.
        scales: their natural scales, ``(candidate,)``.
    """
    problem, count = found.problem, len(candidates)
    problem = replace(
        problem,
        candidates=(*problem.candidates, *candidates),
        prior_std=np.concatenate([problem.prior_std, PRIOR * scales]),
    )
    natural = found.natural
    natural = replace(natural, coefficient=np.concatenate([natural.coefficient, scales]))
    point = found.best.fit.point
    begin = replace(point, xi=np.concatenate([point.xi, np.zeros(count)]))
    earlier = [law.members for law in found.laws[:REFITTED]]
    laws = select(problem, problem, begin, earlier)
    return replace(found, problem=problem, natural=natural, laws=laws)


def with_laws_within(found: SegmentSearch, wider: SegmentSearch) -> SegmentSearch:
    """Return a search with the laws of a wider one that need none of its further candidates.

    The wider search may have met a better law of the library. If not, nothing changes.

    Args:
        found: a search.
        wider: a search with the same candidates and further ones, see :func:`search_further`.
    """
    count = found.problem.count
    fits = {law.members: law.fit for law in found.laws}
    better = set()
    for law in wider.laws:
        known = fits.get(law.members)
        is_within = max(law.members, default=0) < count
        if is_within and (known is None or law.fit.cost < known.cost):
            point = replace(law.fit.point, xi=law.fit.point.xi[:count])
            fits[law.members] = replace(law.fit, point=point)
            better.add(law.members)
    laws = rank_laws(found.problem, fits)
    return replace(found, laws=laws) if laws[0].members in better else found


def _state_alone(
    problem: WeakConstraintProblem, nodes: np.ndarray, natural: NaturalScales
) -> NodeFit:
    """Fit the nodes under the simulator as it is, with a model error that shrinks."""
    stated = problem.parameters.means.numpy()
    fit = NodeFit(Point.at(nodes, problem.count, stated), math.inf)
    for q in STATE_ALONE:
        fit = fit_nodes(weighted(problem, natural, q, 1.0), fit.point, (), ANNEALING_STEPS)
    return fit


def weighted(
    problem: WeakConstraintProblem, natural: NaturalScales, q: float, prior: float
) -> WeakConstraintProblem:
    """Return F with model error and prior in units of the natural scales."""
    error = np.maximum(q * natural.rate * problem.segments.span, 1e-4 * natural.size)
    largest = np.maximum(natural.coefficient, _values(problem))
    prior_std = np.minimum(prior * natural.coefficient, largest)
    return problem.with_weights(error, prior_std)


def _values(problem: WeakConstraintProblem) -> np.ndarray:
    """Return the size of every parameter, ``(candidate,)``; infinite for a term.

    It bounds the prior std of a change, unless the natural scale is larger. Several natural scales
    are too wide for a stated value: a gravity of -45 could take the place of a missing drag.
    """
    known = problem.simulator.systems[0].config.parameters
    return np.array([math.inf if c.equation else abs(known[c.name]) for c in problem.candidates])
