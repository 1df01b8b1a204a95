"""The library without the default terms that no data could tell from others on this simulation."""

from __future__ import annotations

from dataclasses import replace

from torch import Tensor

from dashred.physics.library import check_collinear, uninformative_terms
from dashred.pipeline.problem import Problem


def keep_identifiable_terms(problem: Problem, states: Tensor, t: float | Tensor) -> Problem:
    """Return the problem with a library of which no two terms are proportional on the simulation.

    Of the default library the later of two is left out: a field that is never negative is its own
    magnitude. So is what vanishes, as ``exp(-u**2)`` of pascals, or is not finite. A list of the
    user's own with such terms is refused.

    Args:
        problem: as it was posed.
        states: of the simulation, ``(time, field, *grid)``.
        t: time of all of them, or of each, ``(time,)``.

    Raises:
        InputError: two terms of the user's list are proportional, or one vanishes, or is not
            finite.
    """
    system, library = problem.system, problem.library
    if problem.config.library is not None:
        check_collinear(system, library, states, t)
        return problem
    left_out = uninformative_terms(system, library, states, t)
    kept = [term for term in library if term not in left_out]
    others, whole = (
        tuple(replace(episode, library=kept) for episode in episodes)
        for episodes in (problem.others, problem.whole)
    )
    return replace(problem, library=kept, left_out=left_out, others=others, whole=whole)
