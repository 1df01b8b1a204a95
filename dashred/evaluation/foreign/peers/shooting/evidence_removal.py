"""State and law together, terms removed one by one, by the Bayesian evidence: ODR-BINDy.

After Fung, *Overcoming error-in-variable problem in data-driven model discovery by orthogonal
distance regression* (arXiv 2507.23426, 2025): noise in the states and small errors of the equations
are minimised together, terms are removed one by one, and the law of the largest evidence in
Laplace's approximation is taken. Written from that description; its public code is for MATLAB.
It differs from it: the flow from sample to sample stands in for finite differences, the equations
are enforced step by step, and of all terms only some that the linear approximation finds least
needed are tried at each removal.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import LinAlgError

from dashred.evaluation.baselines.estimate import TermEntry
from dashred.evaluation.foreign.peers.measured import Measured, check_fit, entries_of
from dashred.evaluation.foreign.peers.shooting.joint_fit import Point
from dashred.evaluation.foreign.peers.shooting.term_removal import (
    fit_all_terms,
    fit_without,
    needs,
)

# Its authors' prior std of a coefficient.
PRIOR = 100.0
# Terms that are tried at each removal, and removals without a gain after which it ends.
TRIED, PATIENCE = 4, 3


def largest_evidence(given: Measured) -> list[TermEntry]:
    """Return the law of the largest evidence among those that removal meets.

    Raises:
        ArithmeticError: the simulator blows up between two samples.
        NoAnswerError: the law does not fit the readings.
    """
    terms = given.library
    point = fit_all_terms(given)
    kept, best, least = terms, point, negative_log_evidence(point)
    without_gain = 0
    while terms and without_gain < PATIENCE:
        least_needed = np.argsort(needs(point))[:TRIED].tolist()
        found = [fit_without(given, terms, point, j) for j in least_needed]
        tried = [each for each in found if each is not None]
        if not tried:
            break
        terms, point = min(tried, key=lambda each: negative_log_evidence(each[1]))
        value = negative_log_evidence(point)
        without_gain += 1
        if value < least:
            kept, best, least, without_gain = terms, point, value, 0
    check_fit(best.cost / given.readings.size)
    return entries_of(kept, best.coefficients)


def negative_log_evidence(point: Point) -> float:
    """Return ``cost/2 + ln det(A)/2 + k ln p``, up to a constant; infinite if it has none.

    The information A of the k coefficients is that of the readings, with the states eliminated,
    and that of the prior, 1/p². The value of the prior at the coefficients is included.
    """
    count = len(point.coefficients)
    try:
        information = point.information()
    except LinAlgError:
        return math.inf
    sign, size = np.linalg.slogdet(information + np.eye(count) / PRIOR**2)
    prior = float(np.sum((point.coefficients / PRIOR) ** 2))
    return (point.cost + prior + size) / 2 + count * math.log(PRIOR) if sign > 0 else math.inf
