"""States a small step along tangents, to differentiate the observations, which may be nonlinear."""

from __future__ import annotations

import torch
from torch import Tensor

# Largest change of a state, as a share of its largest value.
DIFFERENCE = 1e-5


def states_along(states: Tensor, tangents: Tensor, spread: float) -> tuple[Tensor, Tensor]:
    """Return ``u + h w`` and the steps h, so that ``H'(u) w ≈ (H(u + h w) − H(u))/h``.

    Args:
        states: u, ``(sample, *state)``.
        tangents: w, ``(sample, column, *state)``.
        spread: scale of a state that is zero everywhere.

    Returns:
        the moved states, ``(sample, column, *state)``, and h, ``(sample, column)``.
    """
    largest = tangents.abs().flatten(2).amax(dim=2).clamp(min=1e-300)
    scale = states.abs().flatten(1).amax(dim=1, keepdim=True)
    size = DIFFERENCE * torch.where(scale > 0, scale, spread) / largest
    steps = size.reshape(*size.shape, *(1,) * (states.dim() - 1))
    return states[:, None] + steps * tangents, size
