"""State and law together, terms removed one by one, by the Bayesian information criterion.

After Meissner & Glasner, *Simultaneous model discovery and state estimation under high data
corruption* (arXiv 2406.06707, 2024): the states at all samples and the coefficients of all terms
are fitted together by a Levenberg–Marquardt method, terms are removed one by one, and the law of
the least criterion is taken. Written from that description. It differs from it: the Gauss–Newton
matrix stands in for the full Hessian, there is no penalty that makes coefficients small, the std of
the noise is told, and the equations nearly hold. Multiple shooting from sample to sample and
removal by the criterion is also dashred's own search without all that it adds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.linalg import LinAlgError

from dashred.evaluation.baselines.estimate import TermEntry
from dashred.evaluation.foreign.cases.case import Array
from dashred.evaluation.foreign.peers.measured import Measured, check_fit, entries_of
from dashred.evaluation.foreign.peers.shooting.joint_fit import VIOLATIONS, JointFit, Point
from dashred.physics.system import Term

ITERATIONS, ITERATIONS_AFTER_REMOVAL = 40, 6


def joint_state_and_law(given: Measured) -> list[TermEntry]:
    """Return the law of the least criterion ``cost + k ln n``, k terms and n readings.

    Raises:
        ArithmeticError: the simulator blows up between two samples.
        NoAnswerError: the law does not fit the readings.
    """
    terms = given.library
    point = fit_all_terms(given)
    penalty = math.log(given.readings.size)
    kept, best = terms, point
    least = point.cost + penalty * len(terms)
    while terms:
        remaining = fit_without(given, terms, point, int(np.argmin(needs(point))))
        if remaining is None:
            break
        terms, point = remaining
        criterion = point.cost + penalty * len(terms)
        if criterion < least:
            kept, best, least = terms, point, criterion
    check_fit(best.cost / given.readings.size)
    return entries_of(kept, best.coefficients)


def fit_all_terms(given: Measured) -> Point:
    """Return the fit of all terms; the equations are enforced step by step."""
    fit = JointFit(given, given.library)
    point = fit.minimise(
        given.first_states, np.zeros(len(given.library)), VIOLATIONS[0], ITERATIONS
    )
    for violation in VIOLATIONS[1:]:
        point = fit.minimise(point.states, point.coefficients, violation, ITERATIONS)
    return point


def fit_without(
    given: Measured, terms: Sequence[Term], point: Point, removed: int
) -> tuple[list[Term], Point] | None:
    """Return the other terms and their fit; None if the states run away without the removed term.

    Args:
        given: readings and simulator.
        terms: of the fit before.
        point: the fit before.
        removed: index of the term.
    """
    others = [term for j, term in enumerate(terms) if j != removed]
    try:
        fitted = JointFit(given, others).minimise(
            point.states,
            np.delete(point.coefficients, removed),
            VIOLATIONS[-1],
            ITERATIONS_AFTER_REMOVAL,
        )
    except ArithmeticError:
        return None
    return others, fitted


def needs(point: Point) -> Array:
    """Return how much the removal of each term raises the cost, in the linear approximation."""
    try:
        information = point.information()
        size = np.sqrt(np.diag(information).clip(min=1e-300))
        variances = np.diag(np.linalg.pinv(information / np.outer(size, size), hermitian=True))
        return np.asarray((point.coefficients * size) ** 2 / variances.clip(min=1e-300))
    except LinAlgError:
        return np.asarray(point.coefficients**2 * np.diag(point.own))
