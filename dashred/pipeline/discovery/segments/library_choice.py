"""Choose the library of a search over segments.

Equations that only define a rate, such as ``x' = v``, get candidates if no law of the others
explains the record. Terms one step beyond the library are used if a law with them is better by more
than chance (docs/method.md#fit-over-segments).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from dashred.inference.fit.forecast_choice import MOST_TERMS
from dashred.inference.forward.candidates import Candidate
from dashred.inference.hypotheses.extended.extended_library import (
    build_extended_candidates,
    extended_terms,
)
from dashred.inference.segments.natural_scales import natural_scales
from dashred.inference.segments.selection.beside_errors import EXPLAINED, search_beside_errors
from dashred.inference.segments.selection.correlated_ranking import (
    has_correlated_residuals,
    rank_correlated,
)
from dashred.inference.segments.selection.equivalent_laws import merge_equivalent
from dashred.inference.segments.selection.left_force import forced_score
from dashred.inference.segments.selection.search import (
    SegmentSearch,
    search_further,
    with_laws_within,
)
from dashred.inference.segments.selection.set_selection import SegmentLaw
from dashred.physics.expressions import algebra
from dashred.physics.system import System
from dashred.physics.terms.library import WAVES, angles, build_library, calls, default_terms
from dashred.pipeline.discovery.identifiable_terms import keep_identifiable_terms
from dashred.pipeline.discovery.segments.hidden_state_stage import with_hidden_state
from dashred.pipeline.discovery.segments.segment_search import search_library
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import NominalRun
from dashred.pipeline.simulation.state_samples import state_samples

# Sensor errors and hidden states are searched beside laws of more terms, or if the record is not
# explained.
SIMPLE_TERMS = 2
# Definitions get candidates if the misfit per reading is above this limit, and if it then decreases
# below this share.
UNEXPLAINED, GAIN = 5.0, 0.5
# A law that leaves only noise has a smaller misfit per reading, because the states are fitted, too.
NOISE = 1.0
# Two laws explain the record as well if their misfits differ by less than this factor.
AS_WELL = 1.1
# A law beyond the library has to be better than those of the library by this difference in score,
# and it has to have a few terms: with many more, the function beyond the library explains little.
# With more candidates than this, no terms are added.
EXTENSION_GAIN, MAX_CANDIDATES = 10.0, 200
# A term beyond the library whose cosine with one of the library is larger is nearly proportional.
ALIKE = 0.98
# A term beyond the library has to act on more than this share of the record.
FEWEST_SHARE = 0.05


def search_libraries(problem: Problem, nominal: NominalRun) -> tuple[Problem, SegmentSearch | None]:
    """Return the problem with the library that was needed, and the laws; None if none is fitted."""
    narrow = _without_measured_definitions(problem, nominal)
    found = None if narrow is None else search_library(narrow, nominal)
    is_narrow = narrow is not None and found is not None and is_explained(found)
    if narrow is not None and is_narrow:
        problem = narrow
    else:
        found = search_library(problem, nominal)
    beside = None if found is None else _beside_errors(found)
    opened = None
    if problem.config.library is None and not (beside is not None and not beside.best.members):
        opened = _with_definitions(problem, nominal, found)
    if opened is not None:
        problem, found = opened
    if found is None:
        return problem, found
    is_simple = is_narrow and opened is None and beside is None
    wider, further = (problem, found) if is_simple else _extend(problem, nominal, found)
    # A law of many terms may imitate a hidden state.
    if further.level > NOISE or len(further.best.members) > SIMPLE_TERMS:
        hidden = with_hidden_state(problem, further, beside)
        if hidden is not None:
            return hidden
    told = wider, further
    if beside is not None and _score(beside) < _score(further) - EXTENSION_GAIN:
        told = problem, beside
    if has_correlated_residuals(told[1]):
        both = [(wider, further), *([] if beside is None else [(problem, beside)])]
        ranked = [(each, merge_equivalent(rank_correlated(laws))) for each, laws in both]
        told = min(ranked, key=lambda pair: pair[1].best.score)
    return told


def _beside_errors(found: SegmentSearch) -> SegmentSearch | None:
    """Return the laws beside sensor errors; None if a law of a few terms explains the record."""
    if is_explained(found) and len(found.best.members) <= SIMPLE_TERMS:
        return None
    beside = search_beside_errors(found)
    return None if beside is None else merge_equivalent(beside)


def _score(found: SegmentSearch) -> float:
    """Return ``-2 ln p(y)`` of the best law, up to a constant."""
    return found.walking(found.best).score


def _with_definitions(
    problem: Problem, nominal: NominalRun, found: SegmentSearch | None
) -> tuple[Problem, SegmentSearch] | None:
    """Return the laws with terms in equations that define a rate; None if none are needed.

    They are needed if nothing else explains the record: no law, and no force in the other
    equations. They are used as well if fewer of them explain it: if y is not measured, a term in
    ``x' = y`` only redefines y.
    """
    system = problem.system
    closed = set(system.fields) - {term.equation for term in problem.library}
    unexplained = found is None or found.level > UNEXPLAINED
    if found is not None and not unexplained:
        measured = {sensor.reads for sensor in problem.split.fit.sensors} & set(system.fields)
        closed = {
            field
            for field in closed & measured
            if len(found.best.members) > 1
            and _defines_hidden(system.resolved[field], system.fields, measured)
        }
    if not closed:
        return None
    equations = closed | {term.equation for term in problem.library}
    wider = _with_terms_in(problem, nominal, [f for f in system.fields if f in equations])
    wider = _without_rescaling(wider)
    again = search_library(wider, nominal)
    if again is None:
        return None
    if found is None:
        return wider, again
    is_better = again.level < GAIN * found.level if unexplained else _is_simpler(again, found)
    return (wider, again) if is_better and _score(again) < forced_score(found) else None


def _is_simpler(found: SegmentSearch, other: SegmentSearch) -> bool:
    """Tell whether a law has fewer terms than another one, and explains the record as well."""
    misfit, least = (float(f.level * np.square(f.problem.noise_std).mean()) for f in (found, other))
    fewer = len(found.best.members) < len(other.best.members)
    return fewer and misfit < AS_WELL * least


def is_explained(found: SegmentSearch) -> bool:
    """Return whether the residuals of the best law are noise."""
    return found.level < EXPLAINED


def _extend(
    problem: Problem, nominal: NominalRun, found: SegmentSearch
) -> tuple[Problem, SegmentSearch]:
    """Add the terms beyond the library that a better law needs."""
    samples = state_samples(problem, nominal)
    system, library = problem.system, problem.library
    further = build_extended_candidates(samples.system, library, samples.states, samples.times)
    further = _distinct(found, [c for c in further if not _is_wave_of_no_angle(system, c)])
    if not further or len(found.problem.candidates) + len(further) > MAX_CANDIDATES:
        return problem, found
    again = merge_equivalent(search_further(found, further, _scales(found, further)))
    within = next((law for law in again.laws if not _extended(again, law)), None)
    needed, count = _extended(again, again.best), len(again.best.members)
    gains = within is None or again.best.score < within.score - EXTENSION_GAIN
    if not needed or not gains or count > MOST_TERMS:
        return problem, with_laws_within(found, again)
    terms = extended_terms(system, library)
    chosen = [term for term in terms if f"{term.equation}: {term}" in needed]
    return problem.with_extensions(chosen), again


def _is_wave_of_no_angle(system: System, candidate: Candidate) -> bool:
    """Tell whether a candidate is a sine or cosine of a field that is no angle."""
    waves = [e for term in candidate.terms for e in calls(term.expression, WAVES)]
    named = {name for expr in waves for name in algebra.names(expr)}
    return bool(named & set(system.fields) - angles(system))


def _distinct(found: SegmentSearch, further: Sequence[Candidate]) -> list[Candidate]:
    """Return the candidates that are distinct from the terms of the same equation.

    Two functions that are nearly proportional, such as a step and a smooth step, could make up for
    anything by their difference. A function that acts at a few samples only, such as the
    exponential of a large field, could make up for an outlier.
    """
    weak, nodes = found.problem, found.best.fit.point.nodes
    candidates = [*weak.parameters.candidates, *weak.candidates]
    _, columns, equations, owners = weak.simulator.tendencies(nodes, [*candidates, *further])
    units = columns / np.maximum(np.linalg.norm(columns, axis=1, keepdims=True), 1e-300)
    alike = (np.abs(units @ units.T) > ALIKE) & (equations[:, None] == equations)
    known = owners < len(candidates)
    squares = np.square(units)
    spread = squares.sum(axis=1) ** 2 / np.maximum(np.square(squares).sum(axis=1), 1e-300)
    few = spread < FEWEST_SHARE * len(nodes)
    taken = {int(j) for j in owners[alike[:, known].any(axis=1) | few]}
    return [c for j, c in enumerate(further, start=len(candidates)) if j not in taken]


def _scales(found: SegmentSearch, further: Sequence[Candidate]) -> NDArray[np.float64]:
    """Return the natural scales of further candidates, ``(candidate,)``."""
    weak, nodes = found.problem, found.best.fit.point.nodes
    return natural_scales(
        weak.simulator, weak.sensors, further, nodes, found.natural.size, weak.noise_std
    ).coefficient


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


def _without_rescaling(problem: Problem) -> Problem:
    """Return the problem without terms in ``x' = c y`` that vanish with y, if no sensor reads y.

    They only measure y in another unit, which may depend on the state. The prior of y's start may
    favour a unit that fits it.
    """
    system, fields = problem.system, problem.system.fields
    measured = {sensor.reads for sensor in problem.split.fit.sensors} & set(fields)
    without: dict[str, dict[str, algebra.Expr]] = {}
    for field in fields:
        if _defines_hidden(system.resolved[field], fields, measured):
            rest = algebra.split_coefficient(system.resolved[field])[1]
            without[field] = dict.fromkeys(algebra.names(rest), algebra.ZERO)
    kept = [
        term
        for term in problem.library
        if term.equation not in without
        or algebra.substitute(term.expression, without[term.equation]) != algebra.ZERO
    ]
    return problem.with_library(kept)


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
    return keep_identifiable_terms(problem, state_samples(problem, nominal))
