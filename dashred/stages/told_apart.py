"""The library without the default terms that no data could tell from others on this simulation."""

from __future__ import annotations

from dataclasses import replace

from torch import Tensor

from dashred.physics.library import proportional_terms, refuse_collinear
from dashred.stages.problem import Problem


def told_apart(problem: Problem, states: Tensor) -> Problem:
    """Return the problem with a library of which no two terms are proportional on the simulation.

    Of the default library the later of two is left out: a field that is never negative is its own
    magnitude. A list of the user's own is refused with the two named.

    Args:
        problem: as it was posed.
        states: of the simulation, ``(time, field, *grid)``.

    Raises:
        InputError: two terms of the user's list are proportional; or one of any library vanishes,
            or is not finite.
    """
    system, library, begin = problem.system, problem.library, float(problem.times[0])
    if problem.config.library is not None:
        refuse_collinear(system, library, states, begin)
        return problem
    same = proportional_terms(system, library, states, begin)
    kept = [term for term in library if term not in same]
    others, whole = (
        tuple(replace(episode, library=kept) for episode in episodes)
        for episodes in (problem.others, problem.whole)
    )
    return replace(problem, library=kept, same=same, others=others, whole=whole)
