"""Integrals over the axes, without mirror images, of fields on rings."""

from __future__ import annotations

from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.physics.grids.grid import Axis, Grid


def integral(grid: Grid, field: Float[Tensor, "*batch_and_grid"]) -> Float[Tensor, "*batch"]:
    """Return ``∫ f dx`` over the axes, without mirror images; for an ODE system, f itself.

    The result is the integral of the trigonometric interpolant, which is exact for resolved
    fields, whether odd or even about an end.

    Args:
        grid: with the axes.
        field: on the rings, ``(*batch, *grid)``.
    """
    for axis in reversed(grid.axes):
        field = field @ _weights(axis)
    return field


@lru_cache
def _weights(axis: Axis) -> Tensor:
    """Return ``w_j = (1/M) Σ_k e^{-i k x_j} ∫₀ᴸ e^{i k x} dx``, ``(point,)``."""
    points = axis.ring_points
    if axis.staggered:
        # The midpoint rule over the cells, which are at odd points.
        return 2 * axis.spacing * (torch.arange(points) % 2).double()
    k = 2 * torch.pi * torch.fft.fftfreq(points, d=axis.spacing, dtype=torch.float64)
    turned = torch.exp(1j * k * axis.length) - 1
    waves = torch.where(k == 0, axis.length + 0j, turned / (1j * torch.where(k == 0, 1.0, k)))
    if points % 2 == 0:
        # The Nyquist mode is a cosine, whose integral is zero.
        waves[points // 2] = 0
    return torch.fft.fft(waves).real / points
