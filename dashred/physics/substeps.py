"""Steps of an explicit method that are divided until they are stable.

With the spectral radius ρ of the derivative of N, a step h is m steps of the method, such that
``h ρ / m`` is within its region of stability. ρ is measured at the first state by power iteration
with differences.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor

from dashred.physics.runge_kutta import Tableau, advance

Rate = Callable[[Tensor, float], Tensor]

# Largest h ρ of a step of the classical method, whatever the direction of the eigenvalue; and the
# most steps in one: more are a law that is far too stiff, and blows up.
LIMIT, MOST_STEPS = 2.5, 200
# Iterations, the last of which count, and the factor that they may be short of.
ITERATIONS, COUNTED, SAFETY = 8, 2, 1.5
# Length of the differences, as a share of the largest value of a state, now or after a step.
DIFFERENCE = 1e-6


class Substeps:
    """The flow of a rate by a method of fourth order, with as many steps as stability takes.

    Args:
        tableau: the method.
        rate: N: ``(u, t)`` → the rate of change, ``(batch, field, *grid)``.
    """

    def __init__(self, tableau: Tableau, rate: Rate) -> None:
        self.tableau, self.rate = tableau, rate
        self._radius: float | None = None

    def __call__(self, state: Tensor, t: float, h: float) -> Tensor:
        """Return the states at ``t + h``."""
        if self._radius is None:
            self._radius = spectral_radius(self.rate, state, t, h)
        count = min(max(1, math.ceil(h * self._radius / LIMIT)), MOST_STEPS)
        for i in range(count):
            state = advance(self.tableau, self.rate, state, t + i * h / count, h / count)
        return state


def spectral_radius(rate: Rate, state: Tensor, t: float, h: float) -> float:
    """Return the largest spectral radius of ``∂N/∂u`` in a batch, with a margin.

    Args:
        rate: N.
        state: u, ``(batch, field, *grid)``; states that are not finite do not count.
        t: time.
        h: step, which gives the scale of a state at rest, ``h N(u)``.
    """
    state = state[torch.isfinite(state).flatten(1).all(dim=1)]
    if not len(state):
        return 0.0
    shape = (-1,) + (1,) * (state.dim() - 1)
    generator = torch.Generator().manual_seed(0)
    before = rate(state, t)
    scale = torch.maximum(state.abs(), h * before.abs().nan_to_num(nan=0.0, posinf=0.0))
    length = DIFFERENCE * scale.flatten(1).amax(dim=1).clamp(min=1e-100)
    direction = torch.randn(state.shape, generator=generator, dtype=torch.float64)
    sizes = []
    for _ in range(ITERATIONS):
        norm = direction.flatten(1).norm(dim=1).clamp(min=1e-100)
        step = (length / norm).reshape(shape) * direction
        direction = (rate(state + step, t) - before) / length.reshape(shape)
        sizes.append(direction.flatten(1).norm(dim=1))
    found = torch.stack(sizes[-COUNTED:]).nan_to_num(nan=0.0, posinf=0.0)
    return SAFETY * float(found.max())
