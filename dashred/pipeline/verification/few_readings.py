"""How many readings a law has to explain, and how many numbers were fitted to them."""

from __future__ import annotations

import numpy as np

from dashred.core.findings.cause_schema import Verdict
from dashred.pipeline.problem import Problem

# Readings for each coefficient, beside those that determine the start. Fewer do not prove a law:
# many laws with as many terms fit them.
FEWEST_READINGS = 8
# Verdicts that state one law without reserve.
FIRM: tuple[Verdict, ...] = ("missing-term", "parameter")


def fitted_readings(problem: Problem) -> int:
    """Return the number of readings of the fit, over all episodes."""
    return sum(int(np.isfinite(each.split.fit.values).sum()) for each in problem.episodes)


def start_values(problem: Problem) -> int:
    """Return the number of start values of an ODE system, over all episodes; 0 for another system.

    The start of a field in space is a prior with many modes, most of which the readings leave as
    they are.
    """
    system = problem.system
    return 0 if system.axes else len(system.fields) * len(problem.episodes)


def are_too_few(verdict: Verdict, coefficients: int, readings: int, start: int) -> bool:
    """Return whether the verdict states a law that so few readings do not prove.

    Args:
        verdict: that the best law has.
        coefficients: of this law.
        readings: as of :func:`fitted_readings`.
        start: as of :func:`start_values`.
    """
    return verdict in FIRM and readings - start < FEWEST_READINGS * coefficients
