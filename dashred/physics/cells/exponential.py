"""Coefficients of ETDRK4 for a dense linear part."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Terms of the Taylor series for a norm of at most 1/2: the remainder is below rounding errors.
TERMS = 14
FUNCTIONS = 4


class StepMatrices(NamedTuple):
    """Matrices of one step of length h for ``v' = A v + N(v, t)``, each ``(n, n)``.

    The scheme is that of Cox and Matthews, J. Comput. Phys. 176, 2002.

    Attributes:
        full, half: ``exp(hA)`` and ``exp(hA/2)``.
        stage: ``h/2 φ₁(hA/2)``.
        first, middle, last: weights of the stages at the end of the step.
    """

    full: Array
    half: Array
    stage: Array
    first: Array
    middle: Array
    last: Array


def step_matrices(linear: Array, h: float) -> StepMatrices:
    """Return the matrices of a step.

    Args:
        linear: A, ``(n, n)``, per unit of time.
        h: length of the step.
    """
    at_half = phi_functions(h / 2 * linear)
    e, f1, f2, f3 = _doubled(at_half)
    return StepMatrices(
        full=e,
        half=at_half[0],
        stage=h / 2 * at_half[1],
        first=h * (f1 - 3 * f2 + 4 * f3),
        middle=h * (2 * f2 - 4 * f3),
        last=h * (4 * f3 - f2),
    )


def phi_functions(matrix: Array) -> list[Array]:
    """Return ``φ₀ … φ₃`` of a matrix, with ``φ₀ = exp`` and ``φ_{k+1}(z) = (φ_k(z) - 1/k!)/z``.

    Taylor series of the scaled matrix, then doubling of the argument: Skaflestad and Wright,
    *The scaling and modified squaring method*, Appl. Numer. Math. 59, 2009.

    Args:
        matrix: ``(n, n)``.
    """
    norm = float(np.abs(matrix).sum(axis=0).max())
    doublings = max(0, math.ceil(math.log2(max(norm, 1e-300))) + 1)
    scaled, eye = matrix / 2**doublings, np.eye(len(matrix))
    last = eye / math.factorial(TERMS + FUNCTIONS - 1)
    for k in range(TERMS + FUNCTIONS - 2, FUNCTIONS - 2, -1):
        last = scaled @ last + eye / math.factorial(k)
    found = [last]
    for k in range(FUNCTIONS - 2, -1, -1):
        found.insert(0, scaled @ found[0] + eye / math.factorial(k))
    for _ in range(doublings):
        found = _doubled(found)
    return found


def _doubled(phi: list[Array]) -> list[Array]:
    """Return the functions of twice the argument."""
    result = [phi[0] @ phi[0]]
    for k in range(1, len(phi)):
        rest = sum(phi[j] / math.factorial(k - j) for j in range(1, k + 1))
        result.append((phi[0] @ phi[k] + rest) / 2**k)
    return result
