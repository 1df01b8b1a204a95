"""Choose the library of a search over segments: identities stay closed, one step beyond it is tried.

The candidates of the library come first. Equations that only define a rate, such as ``x' = v``, get
candidates if no law of the others explains the record. Terms one step beyond the library are used if
a law with them is better by more than chance (docs/method.md#fit-over-segments).
"""

from __future__ import annotations

from collections.abc import Collection

from dashred.inference.hypotheses.extended.extended_library import extended_terms
from dashred.inference.segments.search import SegmentLaw, SegmentSearch
from dashred.physics.expressions import algebra
from dashred.physics.library import build_library, default_terms
from dashred.pipeline.discovery.identifiable_terms import keep_identifiable_terms
from dashred.pipeline.discovery.segment_search import search_library
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation import NominalRun

# The law explains the record if its misfit per reading is below this limit.
EXPLAINED = 1.7
# Definitions get candidates if the misfit per reading is above this limit, and if it then decreases
# below this share.
UNEXPLAINED, GAIN = 5.0, 0.5
# A law beyond the library has to be better than those of the library by this difference in score.
# With more candidates than this, no terms are added.
EXTENSION_GAIN, MAX_CANDIDATES = 10.0, 200


def search_libraries(problem: Problem, nominal: NominalRun) -> tuple[Problem, SegmentSearch | None]:
    """Return the problem with the library that was needed, and the laws; None if none is fitted."""
    narrow = _without_measured_definitions(problem, nominal)
    if narrow is not None:
        found = search_library(narrow, nominal)
        if found is not None and is_explained(found):
            return narrow, found
    found = search_library(problem, nominal)
    if problem.config.library is None and (found is None or found.level > UNEXPLAINED):
        closed = set(problem.system.fields) - {term.equation for term in problem.library}
        if closed:
            wider = _with_terms_in(problem, nominal, problem.system.fields)
            again = search_library(wider, nominal)
            if again is not None and (found is None or again.level < GAIN * found.level):
                problem, found = wider, again
    return (problem, None) if found is None else _extend(problem, nominal, found)


def is_explained(found: SegmentSearch) -> bool:
    """Return whether the residuals of the best law are noise."""
    return found.level < EXPLAINED


def _extend(
    problem: Problem, nominal: NominalRun, found: SegmentSearch
) -> tuple[Problem, SegmentSearch]:
    """Add the terms beyond the library that a better law needs."""
    terms = extended_terms(problem.system, problem.library)
    if not terms or len(found.problem.candidates) + len(terms) > MAX_CANDIDATES:
        return problem, found
    wider = _identifiable(problem.with_extensions(terms), nominal)
    again = search_library(wider, nominal, [_names(found, found.best)])
    if again is None:
        return problem, found
    within = next((law for law in again.laws if not _extended(again, law)), None)
    needed = _extended(again, again.best)
    if not needed or (within is not None and again.best.score > within.score - EXTENSION_GAIN):
        return problem, found
    chosen = problem.with_extensions(
        [term for term in terms if f"{term.equation}: {term}" in needed]
    )
    laws = search_library(chosen, nominal, [_names(again, again.best)])
    return (problem, found) if laws is None else (chosen, laws)


def _names(found: SegmentSearch, law: SegmentLaw) -> list[str]:
    """Return the names of the candidates of a law."""
    return [str(candidate) for candidate in found.terms(law)[0]]


def _extended(found: SegmentSearch, law: SegmentLaw) -> set[str]:
    """Return the names of the terms of a law that the library does not contain."""
    return {str(candidate) for candidate in found.terms(law)[0] if candidate.is_extended}


def _without_measured_definitions(problem: Problem, nominal: NominalRun) -> Problem | None:
    """Return the problem without terms in equations that define an unmeasured rate; None if none.

    If x is measured and ``x' = ±c y`` is the only equation that tells what y is, a term in it is
    equivalent to a term in the equation of y. The latter is told.
    """
    if problem.config.library is not None:
        return None
    system = problem.system
    measured = {sensor.reads for sensor in problem.split.fit.sensors} & set(system.fields)
    definitions = {
        field
        for field in measured
        if _defines_hidden(system.resolved[field], system.fields, measured)
    }
    kept = [field for field in system.fields if field not in definitions]
    if not kept or definitions.isdisjoint(term.equation for term in problem.library):
        return None
    return _with_terms_in(problem, nominal, kept)


def _defines_hidden(
    tendency: algebra.Expr, fields: Collection[str], measured: Collection[str]
) -> bool:
    """Tell whether a tendency is a number times one field that no sensor reads."""
    rest = algebra.split_coefficient(tendency)[1]
    return isinstance(rest, algebra.Name) and rest.id in fields and rest.id not in measured


def _with_terms_in(problem: Problem, nominal: NominalRun, equations: Collection[str]) -> Problem:
    """Return the problem with the default terms in some equations."""
    terms = default_terms(problem.system)
    library = build_library(problem.system, dict.fromkeys(equations, terms))
    return _identifiable(problem.with_library(library), nominal)


def _identifiable(problem: Problem, nominal: NominalRun) -> Problem:
    return keep_identifiable_terms(problem, nominal.references[0], problem.times)
