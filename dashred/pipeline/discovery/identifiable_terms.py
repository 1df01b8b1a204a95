"""Identifiable terms of the library."""

from __future__ import annotations

from dataclasses import replace

from dashred.physics.runs.program_definitions import program_definitions
from dashred.physics.terms.library import check_collinear, uninformative_terms
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.state_samples import StateSamples


def keep_identifiable_terms(problem: Problem, samples: StateSamples) -> Problem:
    """Return the problem with a library in which no two terms are proportional on the simulation.

    Of two proportional terms of the default library the later one is removed, such as ``abs(u)``
    for a field that is never negative. Terms that vanish, such as ``exp(-u**2)`` for a pressure in
    pascals, or that are not finite are removed too. In a library that the user lists, such terms
    are errors. Terms that were added to a library are removed like default terms.

    Args:
        problem: problem with the full library.
        samples: states of the simulation.

    Raises:
        InputError: in the library of the user two terms are proportional, or a term vanishes or is
            not finite.
    """
    library = problem.library
    arguments = samples.states, samples.times
    if problem.config.library is not None:
        listed = [term for term in library if term not in problem.extensions]
        check_collinear(samples.system, listed, *arguments)
    left_out = uninformative_terms(samples.system, library, *arguments)
    if problem.config.library is None and problem.system.program is not None:
        # The library of a program has terms in every equation at first.
        defined = program_definitions(samples.system, *arguments)
        left_out |= {
            term: f"is in the equation of {term.equation}, which only defines {other}"
            for field, other in defined.items()
            for term in library
            if term.equation == field
        }
    if not left_out:
        return problem
    identifiable = [term for term in library if term not in left_out]
    extensions = tuple(term for term in problem.extensions if term not in left_out)
    return replace(problem.with_library(identifiable), left_out=left_out, extensions=extensions)
