"""Strong-stability-preserving Runge–Kutta, third order: for finite differences and fronts."""

from __future__ import annotations

from collections.abc import Callable

from torch import Tensor


class SSPRK3:
    """Advance ``u' = N(u, t)`` explicitly (Shu & Osher, J. Comput. Phys. 77, 1988).

    Args:
        tendency: N: ``(u, t)`` → ``(batch, field, *grid)``.
        h: step, in units of time.
    """

    def __init__(self, tendency: Callable[[Tensor, float], Tensor], h: float) -> None:
        self.tendency, self.h = tendency, h

    def step(self, state: Tensor, t: float) -> Tensor:
        """Return the state at ``t + h``."""
        h, tendency = self.h, self.tendency
        first = state + h * tendency(state, t)
        second = (3 * state + first + h * tendency(first, t + h)) / 4
        return (state + 2 * (second + h * tendency(second, t + h / 2))) / 3
