"""Coefficients are read from values alone."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dashred.evaluation.foreign.cases.polynomials import evaluate, read_polynomials, text_of


def test_the_coefficients_of_a_cubic_are_read() -> None:
    read = read_polynomials(lambda s: (2.667 * s[0] * s[1] ** 2 - 1, 0.1 * s[1] - s[0]), 2, 3)
    assert read == [{(0, 1, 1): 2.667, (): -1.0}, {(1,): 0.1, (0,): -1.0}]


@pytest.mark.parametrize(
    "rhs",
    [
        lambda s: (math.sin(s[0]), s[1]),
        lambda s: (s[0] ** 4, s[1]),
        lambda s: (abs(s[0] + 3), s[1]),  # a polynomial within 3 of the origin
        lambda s: ((s[0] + 0j) ** 0.5, s[1]),
        lambda s: (1 / 0, s[1]),
    ],
)
def test_what_is_no_polynomial_of_this_degree_is_refused(rhs) -> None:
    assert read_polynomials(rhs, 2, 3) is None


def test_a_monomial_as_text_and_as_values() -> None:
    assert text_of((0, 0, 1), "xyz") == "x**2*y"
    assert text_of((), "xyz") == "1"
    states = np.array([[2.0, 3.0], [1.0, 5.0]])
    np.testing.assert_array_equal(evaluate((0, 0, 1), states), [12.0, 5.0])
    np.testing.assert_array_equal(evaluate((), states), [1.0, 1.0])
