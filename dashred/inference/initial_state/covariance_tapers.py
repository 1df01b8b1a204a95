"""Covariance localisation: tapers that remove spurious long-range correlations."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.physics.grids.grid import Grid
from dashred.physics.grids.mesh import Mesh


def gaspari_cohn(distance: Tensor, radius: float) -> Tensor:
    """Return the taper of Gaspari & Cohn (Q. J. R. Meteorol. Soc. 125, 1999, eq. 4.10).

    A fifth-order piecewise rational correlation function: 1 at distance 0, 5/24 at ``radius``,
    exactly 0 from ``2·radius`` on.
    """
    r = distance / radius
    near = (((-r / 4 + 1 / 2) * r + 5 / 8) * r - 5 / 3) * r**2 + 1
    far = ((((r / 12 - 1 / 2) * r + 5 / 8) * r + 5 / 3) * r - 5) * r + 4 - 2 / (3 * r.clamp(min=1))
    return torch.where(r < 1, near, torch.where(r < 2, far, torch.zeros_like(r)))


def distances(
    grid: Grid | Mesh, positions: Float[Tensor, "sensor axis"]
) -> Float[Tensor, "sensor ..."]:
    """Return the distance of every grid point from every sensor, around the periodic axes."""
    squared = torch.zeros(len(positions), *(1 for _ in grid.shape), dtype=torch.float64)
    for index, (axis, points) in enumerate(zip(grid.axes, grid.coordinates.values(), strict=True)):
        place = positions[:, index].reshape(-1, *(1 for _ in grid.shape))
        squared = squared + _around(points - place, axis.period).square()
    return squared.sqrt()


def sensor_distances(
    grid: Grid | Mesh, positions: Float[Tensor, "sensor axis"]
) -> Float[Tensor, "sensor sensor"]:
    """Return the distances between the sensors, around the periodic axes."""
    squared = torch.zeros(len(positions), len(positions), dtype=torch.float64)
    for axis, along in zip(grid.axes, positions.T, strict=True):
        squared = squared + _around(along[:, None] - along, axis.period).square()
    return squared.sqrt()


def _around(difference: Tensor, period: float) -> Tensor:
    return (difference + period / 2).remainder(period) - period / 2
