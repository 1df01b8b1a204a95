"""Read the coefficients of a polynomial right-hand side from its values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations_with_replacement

import numpy as np

from dashred.evaluation.foreign.cases.case import Array

Monomial = tuple[int, ...]
"""Indices of the factors, in order: ``(0, 0, 1)`` is x²y, ``()`` is 1."""
Polynomial = dict[Monomial, float]

# Values agree to this share of the largest value; smaller coefficients are rounding errors.
TOLERANCE = 1e-9
POINTS_PER_MONOMIAL = 4


def monomials(variables: int, degree: int) -> list[Monomial]:
    """Return all monomials up to a degree, the constant first."""
    return [
        factors
        for total in range(degree + 1)
        for factors in combinations_with_replacement(range(variables), total)
    ]


def evaluate(monomial: Monomial, states: Array) -> Array:
    """Return the values of a monomial at states ``(time, variable)``."""
    return np.asarray(np.prod(states[:, list(monomial)], axis=1))


def text_of(monomial: Monomial, names: Sequence[str]) -> str:
    """Return a monomial in the equation language: ``x**2*y``, ``1``."""
    powers = {names[i]: monomial.count(i) for i in dict.fromkeys(monomial)}
    return "*".join(n if power == 1 else f"{n}**{power}" for n, power in powers.items()) or "1"


def read_polynomials(
    rhs: Callable[[Array], Sequence[float]], variables: int, degree: int
) -> list[Polynomial] | None:
    """Return the polynomial of each equation; None if one is not a polynomial of this degree.

    The coefficients are a least-squares fit to values at random states. Values at states that are
    up to ten times larger test it: a function that is only piecewise a polynomial is refused.

    Args:
        rhs: tendency of a state ``(variable,)``.
        variables: number of variables.
        degree: largest degree.
    """
    candidates = monomials(variables, degree)
    rng = np.random.default_rng(0)
    states = rng.uniform(-2, 2, (POINTS_PER_MONOMIAL * len(candidates), variables))
    fitted, tested = np.split(np.arange(len(states)), [len(states) // 2])
    states[tested] *= 10
    try:
        with np.errstate(all="ignore"):
            values = np.array([np.asarray(rhs(state)) for state in states])
    except (ArithmeticError, TypeError, ValueError):
        return None
    # Roots of negative numbers are complex.
    if np.iscomplexobj(values) or not np.isfinite(values).all():
        return None
    columns = np.stack([evaluate(monomial, states) for monomial in candidates], axis=1)
    coefficients = np.linalg.lstsq(columns[fitted], values[fitted], rcond=None)[0]
    scale = np.abs(values[fitted]).max(axis=0).clip(min=1e-300)
    error = np.abs(columns[tested] @ coefficients - values[tested]).max(axis=0)
    if (error > TOLERANCE * np.abs(values).max(axis=0).clip(min=1e-300)).any():
        return None
    return [
        {
            monomial: float(f"{value:.12g}")
            for monomial, value in zip(candidates, column, strict=True)
            if abs(value) > TOLERANCE * size
        }
        for column, size in zip(coefficients.T, scale, strict=True)
    ]
