"""Coefficients of ETDRK4 steps in machine code, for the linear parts of many trajectories.

The formulas are those of :mod:`dashred.physics.solvers.etdrk4` and
:mod:`dashred.physics.solvers.phi_functions`, value by value and without temporary arrays.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numba
import numpy as np

from dashred.physics.backends.numba_backend import Array
from dashred.physics.solvers.compiled.tendency import Modes
from dashred.physics.solvers.etdrk4 import Coefficients
from dashred.physics.solvers.phi_functions import SMALL, TERMS

COUNT = len(Coefficients._fields)
# 1/k! up to the last term of the series of φ_3. Numba keeps compiled code with these constants
# until this file changes.
INVERSE_FACTORIALS = np.array([1 / math.factorial(k) for k in range(TERMS + 4)])


def step_factors(linear: Modes, lengths: Sequence[float] | Array) -> Modes:
    """Return the coefficients of :class:`dashred.physics.solvers.etdrk4.Coefficients`.

    Args:
        linear: L, ``(row, field, *modes)``, per unit time.
        lengths: lengths of the steps, in units of time.

    Returns:
        ``(length, 6, row, field, mode)``.
    """
    rows, fields, *modes = linear.shape
    factors = np.empty((len(lengths), COUNT, linear.size), dtype=np.complex128)
    flat = _real_if_possible(linear.reshape(-1))
    for h, of_step in zip(lengths, factors, strict=True):
        _fill(flat, h, of_step)
    return factors.reshape(len(lengths), COUNT, rows, fields, math.prod(modes))


def compile_step_factors() -> None:
    """Compile the code for linear parts with and without an imaginary part."""
    for value in (-1.0, 1j):
        step_factors(np.full((1, 1, 1), value, dtype=np.complex128), [1.0])


def _real_if_possible(values: Modes) -> Modes | Array:
    """Return values without an imaginary part as real ones, which take a third of the time."""
    return values if values.imag.any() else np.ascontiguousarray(values.real)


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _fill(linear: Modes | Array, h: float, factors: Modes) -> None:
    """Write the coefficients ``(6, value)`` of a step of length ``h`` for each value of L."""
    for i in range(len(linear)):
        z = h * linear[i]
        half = z / 2
        exp_half, one_half = _phi_1(half)
        full, one, two, three = _phi_3(z)
        factors[0, i] = full
        factors[1, i] = exp_half
        factors[2, i] = h / 2 * one_half
        factors[3, i] = h * (one - 3 * two + 4 * three)
        factors[4, i] = h * (2 * two - 4 * three)
        factors[5, i] = h * (4 * three - two)


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _phi_1(z: complex) -> tuple[complex, complex]:
    """Return φ_0 and φ_1; see :mod:`dashred.physics.solvers.phi_functions`."""
    if abs(z) >= SMALL:
        full = np.exp(z)
        return full, (full - 1) / z
    one = _series(z, 1)
    return one * z + 1, one


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _phi_3(z: complex) -> tuple[complex, complex, complex, complex]:
    """Return φ_0 to φ_3."""
    if abs(z) >= SMALL:
        full = np.exp(z)
        one = (full - 1) / z
        two = (one - 1) / z
        return full, one, two, (two - INVERSE_FACTORIALS[2]) / z
    three = _series(z, 3)
    two = three * z + INVERSE_FACTORIALS[2]
    one = two * z + 1
    return one * z + 1, one, two, three


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _series(z: complex, k: int) -> complex:
    """Return φ_k for small z."""
    total = INVERSE_FACTORIALS[TERMS + k] + 0 * z
    for j in range(TERMS - 1, -1, -1):
        total = total * z + INVERSE_FACTORIALS[j + k]
    return total
