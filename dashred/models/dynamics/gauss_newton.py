"""Minimise the loss of an assimilation with dynamics over the states and the law."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch

from dashred.core.budget import OutOfTimeError
from dashred.models.dynamics.unknowns import Residuals, Unknowns
from dashred.models.dynamics.weak_constraint import WeakConstraint

# Linearisations at most; the relative decrease of the loss that ends the iteration.
ITERATIONS, TOLERANCE = 10, 3e-3
# First damping, its factor after a step that fails, and the number of steps that may fail.
DAMPING, FACTOR, TRIALS = 1e-3, 10.0, 6


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
        before = found.cost
        for _ in range(TRIALS):
            step = equations.step(damping)
            if step is None:
                damping *= FACTOR
                continue
            moved = at.moved(torch.from_numpy(step[0]), torch.from_numpy(step[1]), terms)
            there = problem.residuals(moved, error, weight)
            # Written so that a simulator that blows up counts as a failure.
            if there.cost < before:
                at, found, damping = moved, there, damping / FACTOR
                break
            damping *= FACTOR
        if not found.cost < (1 - TOLERANCE) * before:
            break
    return at, found
