"""Identifiable terms of the library."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch

from dashred.physics.expressions.algebra import names
from dashred.physics.runs.program_definitions import program_definitions
from dashred.physics.system import Term
from dashred.physics.terms.collinear_terms import (
    KINKS,
    check_collinear,
    uninformative_terms,
)
from dashred.physics.terms.library import calls, resolve
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.state_samples import StateSamples

# Readings on which terms are compared, at most twice as many.
MOST_ROWS = 2000


def keep_identifiable_terms(problem: Problem, samples: StateSamples) -> Problem:
    """Return the problem with a library in which no two terms are proportional on the simulation.

    Of two proportional terms of the default library the later one is removed, such as ``abs(u)``
    for a field that is never negative. Terms that vanish, such as ``exp(-u**2)`` for a pressure in
    pascals, or that are not finite are removed too; so are those of :func:`alike_on_readings`. In a
    library that the user lists, such terms
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
        check_collinear(samples.system, listed, *arguments, samples.moved)
    left_out = uninformative_terms(samples.system, library, *arguments, samples.moved)
    if problem.config.library is None:
        kept = [term for term in library if term not in left_out]
        left_out |= alike_on_readings(problem, kept)
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


def alike_on_readings(problem: Problem, library: Sequence[Term]) -> dict[Term, str | Term]:
    """Return terms with an abs or a sign that are multiples of others on the readings.

    A simulator that lacks a force may reach negative heights: there ``sign(h)`` differs from 1. If
    no reading is negative, the recording does not tell one from the other. Terms of fields that no
    sensor reads itself are not compared, nor are those of fields in space.

    Args:
        problem: with the readings.
        library: the terms.

    Returns:
        The terms, each with the earlier term of which it is a multiple.
    """
    system = problem.system
    columns: dict[str, int] = {}
    for column, sensor in enumerate(problem.split.fit.sensors):
        if sensor.reads in system.fields:
            columns.setdefault(sensor.reads, column)
    if system.axes or system.config.nodes is not None or not columns:
        return {}
    read = np.concatenate([episode.split.fit.values for episode in problem.episodes])
    read = read[np.isfinite(read[:, [*columns.values()]]).all(axis=1)]
    if len(read) > MOST_ROWS:
        # The extremes show whether a sign changes.
        extremes = (read[rows] for rows in (read.argmin(axis=0), read.argmax(axis=0)))
        read = np.concatenate([read[:: len(read) // MOST_ROWS], *extremes])
    states = torch.zeros(len(read), len(system.fields), dtype=torch.float64)
    for name, column in columns.items():
        states[:, list(system.fields).index(name)] = torch.from_numpy(read[:, column])
    ready = zip(library, resolve(system, library), strict=True)
    known = [term for term, own in ready if names(own.expression) <= columns.keys()]
    found = uninformative_terms(system, known, states, 0.0) if len(read) else {}
    return {
        term: other
        for term, other in found.items()
        if isinstance(other, Term) and any(calls(term.expression, KINKS))
    }
