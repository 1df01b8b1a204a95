"""Choose forces and sensor errors beside a law by the evidence, one after the other.

With the linearised problem of a law and some walks (Laplace's approximation)::

    -2 ln p(y) = min F + ln det A - ln det (prior precision of the walks)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dashred.inference.segments.gauss_newton import NodeFit, fit_nodes
from dashred.inference.segments.point import Point
from dashred.inference.segments.selection.candidate_sets import Set
from dashred.inference.segments.selection.causes import Cause, Level, walks_of
from dashred.inference.segments.selection.set_selection import term_price
from dashred.inference.segments.walks import NO_WALKS
from dashred.inference.segments.weak_constraint import WeakConstraintProblem

# A further cause has to lower -2 ln p by more than this.
MARGIN = 10.0
# Largest number of causes beside a law, rounds of fits and choices of levels, and Gauss-Newton
# steps of a fit.
MOST, ROUNDS, STEPS = 3, 4, 8


@dataclass(frozen=True)
class Walking:
    """A law with the causes beside it, fitted.

    Attributes:
        problem: F with their walks.
        members: indices of the law's candidates.
        fit: the nodes, walks and coefficients, and F.
        price: ``ln det A - ln det (prior precision)``, relative to the problem without walks.
        causes: with their levels.
    """

    problem: WeakConstraintProblem
    members: Set
    fit: NodeFit
    price: float = 0.0
    causes: Mapping[Cause, Level] = field(default_factory=dict)

    @property
    def score(self) -> float:
        """``-2 ln p(y)`` up to a constant."""
        return self.fit.cost + self.price + term_price(self.problem) * len(self.members)

    @property
    def misfit(self) -> float:
        """F per reading."""
        return self.fit.cost / self.problem.segments.seen


def add_causes(law: Walking, causes: Sequence[Cause]) -> Walking:
    """Return a law with the causes that the evidence supports.

    Args:
        law: a law, with or without causes.
        causes: that may be added.
    """
    while len(law.causes) < MOST and not law.problem.deadline.is_over:
        tried = [_with_cause(law, cause) for cause in causes if cause not in law.causes]
        best = min(tried, key=lambda each: each.score, default=law)
        if not best.score < law.score - MARGIN:
            break
        law = best
    return law


def walk_price(problem: WeakConstraintProblem, point: Point, members: Sequence[int]) -> float:
    """Return ``ln det A - ln det (prior precision)`` relative to the problem without walks."""
    bare = replace(problem, walks=NO_WALKS)
    still = replace(point, walked=point.walked[:, :0])
    with_walks, without = (
        _log_volume(each, at, members) for each, at in ((problem, point), (bare, still))
    )
    return with_walks - without


def _with_cause(law: Walking, cause: Cause) -> Walking:
    """Return a law with one cause more, its level chosen by the evidence."""
    level, point = cause.levels[len(cause.levels) // 2], _widened(law, cause)
    best = law
    for _ in range(ROUNDS):
        found = _fitted(law, cause, level, point)
        if not found.score < best.score and best is not law:
            break
        best, point, before = found, found.fit.point, level
        level = _best_level(law, cause, found)
        if level is before:
            break
    return best


def _widened(law: Walking, cause: Cause) -> Point:
    """Return the point of a law with the components of one cause more, at zero."""
    point, width = law.fit.point, len(cause.unit)
    forces = len(law.problem.walks.forced)
    place = forces if cause.kind == "force" else point.walked.shape[1]
    walked = np.insert(point.walked, [place] * width, 0.0, axis=1)
    return replace(point, walked=walked)


def _fitted(law: Walking, cause: Cause, level: Level, point: Point) -> Walking:
    causes = {**law.causes, cause: level}
    problem = replace(law.problem, walks=walks_of(causes))
    fit = fit_nodes(problem, point, law.members, STEPS)
    price = walk_price(problem, fit.point, law.members)
    return Walking(problem, law.members, fit, price, causes)


def _best_level(law: Walking, cause: Cause, found: Walking) -> Level:
    """Return the level with the best evidence on the problem that is linearised about a fit."""
    members, point = found.members, found.fit.point
    slopes = found.problem.derivatives(point, members)
    if slopes is None:
        return found.causes[cause]

    def score(level: Level) -> float:
        problem = replace(found.problem, walks=walks_of({**law.causes, cause: level}))
        normal = problem.normal_equations(slopes, point, members)
        least, volume = normal.minimum(), normal.log_determinant()
        if least is None or volume is None:
            return np.inf
        return least + volume + problem.walks.log_prior_variance(problem.segments)

    return min(cause.levels, key=score)


def _log_volume(problem: WeakConstraintProblem, point: Point, members: Sequence[int]) -> float:
    normal = problem.linearise(point, members)
    found = None if normal is None else normal.log_determinant()
    if found is None:
        return np.inf
    return found + problem.walks.log_prior_variance(problem.segments)
