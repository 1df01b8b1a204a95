"""The force that a law leaves unexplained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dashred.core.budget import NEVER
from dashred.inference.fit.law import Law
from dashred.inference.segments.gauss_newton import fit_nodes
from dashred.inference.segments.point import Point
from dashred.inference.segments.segments import Array
from dashred.inference.segments.selection.causes import Cause, possible_forces
from dashred.inference.segments.selection.correlated_noise import (
    correlated_score,
    residual_moments,
)
from dashred.inference.segments.selection.law_tendency import law_tendency
from dashred.inference.segments.selection.search import SegmentSearch
from dashred.inference.segments.selection.walk_choice import MARGIN, Walking, add_causes
from dashred.inference.segments.walks import NO_WALKS
from dashred.physics.terms.library import equations_with_candidates

# Prior of the coefficients of a given law, in units of their size, and steps of its fit.
WIDE, STEPS = 10.0, 8
# A force that is a smaller share of what is missing is not told.
SMALLEST_SHARE = 0.1


@dataclass(frozen=True)
class LeftForce:
    """A force that the evidence supports beside a law.

    Attributes:
        walking: the law with the force.
        gain: evidence for the force, in units of ``2 ln p``.
        force: in every equation, ``(segment, field)``.
        rate: rms tendency of every field, ``(field,)``.
        tendency: of the law alone, ``(segment, field)``.
    """

    walking: Walking
    gain: float
    force: Array
    rate: Array
    tendency: Array

    @property
    def share(self) -> float:
        """Its rms as a share of what is missing in all, law and force, from 0 to 1."""
        force, law = self.force / self.rate, self.tendency / self.rate
        return float(np.linalg.norm(force) / np.linalg.norm(np.hypot(force, law)))


def forces_of(found: SegmentSearch) -> list[Cause]:
    """Return a force in every equation that may get terms."""
    system = found.problem.simulator.systems[0]
    equations = [system.fields.index(field) for field in equations_with_candidates(system)]
    return possible_forces(found.natural.rate, equations)


def best_with(found: SegmentSearch, causes: Sequence[Cause]) -> Walking:
    """Return the best law or the empty one, whichever does better, with causes beside it."""
    empty = next(law for law in found.laws if not law.members)
    laws = [found.best] if found.best is empty else [found.best, empty]
    tried = [add_causes(found.walking(law), causes) for law in laws]
    return min(tried, key=lambda each: each.score)


def forced_score(found: SegmentSearch) -> float:
    """Return the lowest ``-2 ln p(y)`` of the best law and of the empty one, with forces."""
    return best_with(found, forces_of(found)).score


def left_force(found: SegmentSearch, law: Walking) -> LeftForce | None:
    """Return the force that a law leaves; None if the evidence supports none, or a small one.

    Args:
        found: the search that gives the scales.
        law: a law over its segments, with or without sensor errors.
    """
    # This takes little time, and the deadline of the search may be over.
    law = replace(law, problem=replace(law.problem, deadline=NEVER))
    both = add_causes(law, forces_of(found))
    gain = law.score - both.score
    if residual_moments(law.problem, law.members, law.fit).redundancy > 1.0:
        gain = _correlated_score(law) - _correlated_score(both)
    if gain < MARGIN:
        return None
    problem, point, rate = both.problem, both.fit.point, found.natural.rate
    force = np.asarray(problem.walks.forces(point.walked, len(rate)))
    tendency = law_tendency(problem.simulator, point.nodes, *problem.terms(point, both.members))
    left = LeftForce(both, gain, force, rate, tendency)
    return left if left.share > SMALLEST_SHARE else None


def force_beside(found: SegmentSearch, law: Law) -> LeftForce | None:
    """Return the force that a law, fitted along one trajectory, leaves over segments.

    Args:
        found: a search over segments of the same recording.
        law: acts everywhere, without faults.
    """
    xi = law.coefficients.numpy()
    problem = replace(
        found.problem,
        candidates=law.candidates,
        prior_std=WIDE * (np.abs(xi) + law.std.numpy()),
        walks=NO_WALKS,
        deadline=NEVER,
    )
    members, near = tuple(range(len(xi))), found.best.fit.point
    begin = replace(Point.at(near.nodes, len(xi), near.parameters), xi=xi)
    fit = fit_nodes(problem, begin, members, STEPS)
    return left_force(found, Walking(problem, members, fit))


def _correlated_score(law: Walking) -> float:
    return correlated_score(law.problem, law.members, law.fit, law.price)
