"""Explicit Runge–Kutta methods: their Butcher tableaux, and a time step.

All implementations of a method (interpreted, compiled, differentiated) use its tableau. This module
does not import torch, because the configuration looks up methods before torch is loaded.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from torch import Tensor

State = TypeVar("State", float, "Tensor")


# Distance of the first and the last stage from the ends of a step, as a share of the step.
INSIDE = 1e-4


@dataclass(frozen=True)
class Tableau:
    """Butcher tableau of an explicit method for ``u' = N(u, t)``.

    ``k_i = N(u + h Σ_{j<i} a_ij k_j, t + c_i h)`` and ``u(t + h) = u + h Σ_i b_i k_i``.

    Attributes:
        a: coefficients of the earlier stages in each stage; row i has i entries.
        b: weights of the stages, ``(stage,)``.
        c: nodes: the time of each stage as a fraction of the step, ``(stage,)``.
        order: order of convergence.
    """

    a: tuple[tuple[float, ...], ...]
    b: tuple[float, ...]
    c: tuple[float, ...]
    order: int

    @property
    def square(self) -> tuple[tuple[float, ...], ...]:
        """The coefficients a with zeros for the later stages, ``(stage, stage)``."""
        count = len(self.b)
        return tuple((*row, *(0.0,) * (count - len(row))) for row in self.a)

    def with_stages_inside(self) -> Tableau:
        """Return the method with no stage exactly at an end of the step.

        An input that jumps there then has its value of this side of the jump.
        """
        return replace(self, c=tuple(min(max(node, INSIDE), 1 - INSIDE) for node in self.c))


EULER = Tableau(a=((),), b=(1.0,), c=(0.0,), order=1)

MIDPOINT = Tableau(a=((), (1 / 2,)), b=(0.0, 1.0), c=(0.0, 1 / 2), order=2)

# Strong-stability-preserving method for sharp fronts: Shu & Osher, J. Comput. Phys. 77, 1988.
SSPRK3 = Tableau(
    a=((), (1.0,), (1 / 4, 1 / 4)), b=(1 / 6, 1 / 6, 2 / 3), c=(0.0, 1.0, 1 / 2), order=3
)

# Kutta, Z. Math. Phys. 46, 1901: the classical method, and the 3/8 rule with a smaller error.
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
        rate: N: ``(u, t)`` → the rate of change, in the shape of u.
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
