"""Linearise the equations about the fitted values of uncertain parameters.

Every fit uses ``∂N/∂p`` and ``∂H/∂p`` at the values in the system. Where the equations or the
readings are not affine in the uncertain parameters, a search is repeated at the fitted values until
these stay.
"""

from __future__ import annotations

from dashred.core.errors import InputError
from dashred.inference.fit.law import Law
from dashred.inference.results.fitted_parameters import exact_changes, fitted_parameters
from dashred.inference.segments.findings.segment_laws import law_from_segments
from dashred.inference.segments.selection.search import SegmentSearch
from dashred.physics.parameter_sensitivity import acts_linearly
from dashred.pipeline.problem import Problem

# A move by a smaller share of its posterior std changes a parameter's tangent by nothing visible.
MOVED = 0.2


def about_fitted_parameters(problem: Problem, found: SegmentSearch) -> dict[str, float] | None:
    """Return the fitted values of the uncertain parameters; None if no new search is needed.

    Args:
        problem: the problem that was searched.
        found: its laws.
    """
    system = problem.system
    spreads = system.config.parameter_spread
    reads = {name for each in problem.quantities for name in each}
    if not problem.delayed and acts_linearly(system, spreads, reads):
        return None
    fitted = fitted_parameters(system, law_from_segments(found, found.best))
    current = system.config.parameters
    # The time constant of a hidden state has been fitted about its value already.
    stated = [each for each in fitted if each["parameter"] in spreads]
    values = {each["parameter"]: each["value"] for each in stated}
    has_moved = any(
        abs(each["value"] - current[each["parameter"]]) > MOVED * each["std"] for each in stated
    )
    if not has_moved:
        return None
    try:
        problem.with_parameters(values)
    except InputError:
        # The equations are not finite there.
        return None
    return values


def with_fitted_readings(problem: Problem, law: Law) -> Problem:
    """Return the problem with sensors that have the fitted values of parameters.

    Every method is then compared with the recording by the sensors as they were fitted.

    Args:
        problem: the problem that was searched.
        law: the law that is told.
    """
    first_order = {each.candidate.name: each.change for each in law.parameters}
    changes = first_order | exact_changes(problem.system, law)
    known = problem.system.config.parameters
    return problem.with_readings_at({name: known[name] + c for name, c in changes.items()})
