"""Interpolation weights of a field on a uniform grid."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.data.sensors import ObservedAxis
from dashred.physics.grids.cell_interpolation import cell_weights


def interpolation_weights(
    axis: ObservedAxis, positions: Float[Tensor, " sensor"], is_band_limited: bool
) -> Float[Tensor, "sensor point"]:
    """Return the weights of the interpolation that suits the discretisation of an axis.

    Args:
        axis: of the grid.
        positions: in the unit of the axis.
        is_band_limited: whether the fields are spectral.
    """
    if axis.staggered:
        return cell_weights(axis, positions)
    return (trigonometric_weights if is_band_limited else linear_weights)(axis, positions)


def trigonometric_weights(
    axis: ObservedAxis, positions: Float[Tensor, " sensor"]
) -> Float[Tensor, "sensor point"]:
    """Return the weights of the trigonometric interpolant, exact for band-limited fields.

    ``w_j(x) = (1/N) Σ_k c_k cos(2πk (x - x_j)/P)`` for the N points of a ring of length P, with
    ``c_0 = 1``, ``c_k = 2``, and ``c_{N/2} = 1`` for even N: the Nyquist mode is a cosine, so
    that the weights are 1 and 0 at the grid points. The sum is an inverse transform of phases.

    Args:
        axis: the ring.
        positions: in the unit of the axis.
    """
    if not len(positions):
        # An empty batch has no transform.
        return torch.zeros(0, axis.ring_points, dtype=torch.float64)
    modes = torch.arange(axis.ring_points // 2 + 1, dtype=torch.float64)
    # Reduce the phase to one period first, which keeps the cosines of high modes accurate.
    turns = (positions[:, None] / axis.period) % 1.0 * modes % 1.0
    phases = torch.polar(torch.ones_like(turns), -2 * math.pi * turns)
    return torch.fft.irfft(phases, n=axis.ring_points)


def linear_weights(
    axis: ObservedAxis, positions: Float[Tensor, " sensor"]
) -> Float[Tensor, "sensor point"]:
    """Return the weights of linear interpolation between neighbouring points, error O(Δx²)."""
    places = positions / axis.period * axis.ring_points
    left = torch.floor(places)
    share = (places - left)[:, None]
    columns = left.long()[:, None] % axis.ring_points
    weights = torch.zeros(len(positions), axis.ring_points, dtype=torch.float64)
    weights.scatter_add_(1, columns, 1.0 - share)
    return weights.scatter_add_(1, (columns + 1) % axis.ring_points, share)
