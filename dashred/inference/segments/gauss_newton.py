"""Damped Gauss–Newton steps of a weak-constraint problem."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dashred.inference.segments.point import Point
from dashred.inference.segments.weak_constraint import WeakConstraintProblem

DAMPING, LEAST_DAMPING = 1e-3, 1e-9
EASED, RAISED, TRIALS = 5.0, 10.0, 6
# A step that gains a smaller share of F is the last.
TOLERANCE = 1e-3


@dataclass(frozen=True)
class NodeFit:
    """A fit of some candidates and all nodes.

    Attributes:
        point: where it ended.
        cost: F there; infinite where the beginning itself blows up, or if there was no time.
    """

    point: Point
    cost: float


def fit_nodes(
    problem: WeakConstraintProblem,
    begin: Point,
    members: Sequence[int],
    steps: int,
    tolerance: float = TOLERANCE,
) -> NodeFit:
    """Minimise F over the nodes and the coefficients of some candidates.

    Args:
        problem: F.
        begin: where to begin; coefficients of others are held at zero.
        members: indices of the candidates.
        steps: at most so many.
        tolerance: a step that gains a smaller share of F is the last.
    """
    chosen = list(members)
    point, cost, damping = begin.only(chosen), np.inf, DAMPING
    for _ in range(steps):
        if problem.deadline.is_over:
            break
        normal = problem.linearise(point, chosen)
        if normal is None:
            return NodeFit(point, np.inf)
        cost = normal.cost
        for _ in range(TRIALS):
            step = normal.step(damping)
            if step is not None:
                tried = point.moved(step[0], chosen, step[1])
                reached = problem.cost(tried, chosen)
                if reached < cost:
                    break
            damping *= RAISED
        else:
            return NodeFit(point, cost)
        gained, point, damping = cost - reached, tried, max(damping / EASED, LEAST_DAMPING)
        cost = reached
        if gained < tolerance * max(reached, 1.0):
            break
    return NodeFit(point, cost)
