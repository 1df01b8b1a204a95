"""What the calls of a program cost."""

from __future__ import annotations

import math

from dashred.physics.solvers.schedule import round_up
from dashred.pipeline.problem import Problem

# Simulations of the record that a fit of one trajectory takes, its derivatives included.
SIMULATIONS = 200
# Share of the budget that they may take.
SHARE = 0.5


def calls_per_simulation(problem: Problem) -> int:
    """Return the number of calls of the program in a simulation of the longest episode."""
    intervals = (problem.times[1:] - problem.times[:-1]).tolist()
    return sum(max(1, round_up(interval / problem.system.dt)) for interval in intervals)


def takes_too_long(problem: Problem) -> bool:
    """Return whether a program takes too long for a fit of one trajectory.

    Its steps follow each other. Over segments those of all segments are side by side.
    """
    program, limit = problem.system.program, problem.budget.seconds
    if program is None or not math.isfinite(limit):
        return False
    return SIMULATIONS * calls_per_simulation(problem) * program.seconds > SHARE * limit
