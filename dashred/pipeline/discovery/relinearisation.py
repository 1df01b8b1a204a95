"""Linearise the equations about the fitted values of uncertain parameters.

Every fit uses ``∂N/∂p`` at the values in the system. Where the equations are not affine in the
uncertain parameters, a search is repeated at the fitted values until these stay.
"""

from __future__ import annotations

from dashred.core.errors import InputError
from dashred.inference.results.fitted_parameters import fitted_parameters
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
    spreads, system = problem.config.system.parameter_spread, problem.system
    if acts_linearly(system, spreads):
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
