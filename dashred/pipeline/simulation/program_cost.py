"""Whether there is time for the simulations of a program."""

from __future__ import annotations

from dashred.core.budget import OutOfTimeError
from dashred.pipeline.problem import Problem
from dashred.pipeline.time_shares import calls_per_simulation, takes_too_long

# The duration of a call is known within this factor.
UNCERTAINTY = 2.0


def follows_segments(problem: Problem) -> bool:
    """Return whether a program takes too long for a fit of one trajectory.

    Its steps follow each other. Over segments those of all segments are side by side.
    """
    return takes_too_long(problem.system, problem.times, problem.budget)


def check_time(problem: Problem, members: int, stage: str) -> None:
    """Raise an error if there is no time for an ensemble, before it begins.

    Args:
        problem: equations, or a program.
        members: of the ensemble.
        stage: in which it is simulated.

    Raises:
        OutOfTimeError: the simulations of a program would end after the stage, or it is over.
    """
    system, seconds = problem.ensemble_system, 0.0
    if system.program is not None:
        calls = calls_per_simulation(system, problem.times)
        seconds = calls * system.program.seconds_of(members) / UNCERTAINTY
    if problem.deadline(stage).is_over_in(seconds):
        raise OutOfTimeError
