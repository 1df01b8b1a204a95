"""Minimise the loss of an assimilation with dynamics over the states and the law."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch

from dashred.core.budget import OutOfTimeError
from dashred.models.dynamics.unknowns import Residuals, Unknowns
from dashred.models.dynamics.weak_constraint import WeakConstraint

# Linearisations at most; the relative decrease of the loss that ends the iteration.
ITERATIONS, TOLERANCE = 10, 3e-3
# First damping, in units of the diagonal; its factor after a step that fails; how many may fail.
# Many readings determine smooth changes of the states far less than the diagonal says.
DAMPING, FACTOR, TRIALS = 1e-8, 10.0, 12
# A step with less damping leads to the minimum of the linearised problem.
UNDAMPED = 1e-6


def minimise(
    problem: WeakConstraint,
    start: Unknowns,
    terms: Sequence[int],
    error: float,
    weight: float,
    is_over: Callable[[], bool],
) -> tuple[Unknowns, Residuals]:
    """Return the minimum and its residuals, by Gauss–Newton steps with damping.

    This is the incremental form of weak-constraint 4D-Var (Courtier, Thépaut & Hollingsworth, Q. J.
    R. Meteorol. Soc. 120, 1994). Every step solves the linearised problem for all samples at once.

    Args:
        problem: the loss.
        start: where the iteration begins.
        terms: of the law.
        error: q, in std of a field.
        weight: of the background.
        is_over: whether the time is up.
    """
    at, found, damping = start, problem.residuals(start, error, weight), DAMPING
    for _ in range(ITERATIONS):
        try:
            equations = problem.equations(at, terms, error, weight, is_over)
        except OutOfTimeError:
            break
        before, settled = found.cost, False
        for _ in range(TRIALS):
            step = equations.step(damping)
            if step is None:
                damping *= FACTOR
                continue
            moved = at.moved(torch.from_numpy(step[0]), torch.from_numpy(step[1]), terms)
            there = problem.residuals(moved, error, weight)
            # Written so that a simulator that blows up counts as a failure.
            if there.cost < before:
                predicted = before - equations.decrease(step)
                linear = abs(there.cost - predicted) < TOLERANCE * there.cost
                settled = linear and damping < UNDAMPED
                at, found, damping = moved, there, damping / FACTOR
                break
            damping *= FACTOR
        if settled or not found.cost < (1 - TOLERANCE) * before:
            break
    return at, found
