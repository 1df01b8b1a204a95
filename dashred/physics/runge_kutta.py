"""Explicit Runge–Kutta methods: the Butcher tableau of each, and a step of any of them.

Whatever steps, differentiates or compiles such a method reads its numbers here. Nothing here needs
torch, since the configuration looks methods up before it is loaded.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from torch import Tensor

State = TypeVar("State", float, "Tensor")


@dataclass(frozen=True)
class Tableau:
    """The numbers of an explicit method for ``u' = N(u, t)``.

    ``k_i = N(u + h Σ_{j<i} a_ij k_j, t + c_i h)`` and ``u(t + h) = u + h Σ_i b_i k_i``.

    Attributes:
        a: shares of the earlier stages in each stage, row i of i entries.
        b: shares of the stages in the step, ``(stage,)``.
        c: time of each stage in the step, ``(stage,)``.
        order: of convergence.
    """

    a: tuple[tuple[float, ...], ...]
    b: tuple[float, ...]
    c: tuple[float, ...]
    order: int


EULER = Tableau(a=((),), b=(1.0,), c=(0.0,), order=1)

MIDPOINT = Tableau(a=((), (1 / 2,)), b=(0.0, 1.0), c=(0.0, 1 / 2), order=2)

# Strong-stability-preserving, for fronts: Shu & Osher, J. Comput. Phys. 77, 1988.
SSPRK3 = Tableau(
    a=((), (1.0,), (1 / 4, 1 / 4)), b=(1 / 6, 1 / 6, 2 / 3), c=(0.0, 1.0, 1 / 2), order=3
)

# Kutta, Z. Math. Phys. 46, 1901: the classical method, and the 3/8 rule, whose error is smaller.
CLASSICAL = Tableau(
    a=((), (1 / 2,), (0.0, 1 / 2), (0.0, 0.0, 1.0)),
    b=(1 / 6, 1 / 3, 1 / 3, 1 / 6),
    c=(0.0, 1 / 2, 1 / 2, 1.0),
    order=4,
)
THREE_EIGHTHS = Tableau(
    a=((), (1 / 3,), (-1 / 3, 1.0), (1.0, -1.0, 1.0)),
    b=(1 / 8, 3 / 8, 3 / 8, 1 / 8),
    c=(0.0, 1 / 3, 2 / 3, 1.0),
    order=4,
)


def advance(
    tableau: Tableau, rate: Callable[[State, float], State], state: State, t: float, h: float
) -> State:
    """Return the state at ``t + h``.

    Args:
        tableau: the method.
        rate: N: ``(u, t)`` → the rate of change, shaped as u.
        state: u at t.
        t: time.
        h: step, in units of time.
    """
    rates: list[State] = []
    for shares, node in zip(tableau.a, tableau.c, strict=True):
        rates.append(rate(_add_rates(state, h, shares, rates), t + node * h))
    return _add_rates(state, h, tableau.b, rates)


def _add_rates(state: State, h: float, shares: Sequence[float], rates: Sequence[State]) -> State:
    for share, rate in zip(shares, rates, strict=True):
        if share:
            state = state + (h * share) * rate
    return state
