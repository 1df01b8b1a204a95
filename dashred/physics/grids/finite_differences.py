"""Finite differences on periodic axes: second-order central, and upwind for fluxes."""

from __future__ import annotations

import torch
from torch import Tensor

from dashred.physics.grids.grid import Grid
from dashred.physics.grids.grid_value import Value, on_points, on_whole_grid, total
from dashred.physics.grids.spectral import Spectral


class FiniteDifferences:
    """Second-order central differences and a first-order upwind flux on periodic axes."""

    def __init__(self, grid: Grid) -> None:
        self.grid = grid
        self._spectral = Spectral(grid)

    def on_grid(self, value: Value) -> Tensor | float:
        """Return the field on the grid."""
        return on_points(value)

    def derivative(self, value: Value, axis: str, order: int) -> Value:
        """Apply ``(f₊ - 2f + f₋)/h²`` order // 2 times, then ``(f₊ - f₋)/2h`` for odd orders."""
        points, dim, h = self._along(value, axis)
        for _ in range(order // 2):
            points = (points.roll(-1, dim) - 2 * points + points.roll(1, dim)) / h**2
        if order % 2:
            points = (points.roll(-1, dim) - points.roll(1, dim)) / (2 * h)
        return Value(points)

    def laplacian(self, value: Value) -> Value:
        """Return the sum of second differences over the axes."""
        return total([self.derivative(value, axis.name, 2) for axis in self.grid.axes])

    def inverse_laplacian(self, value: Value) -> Value:
        """Return the spectral inverse, because the operator has no local stencil."""
        return Value(self._spectral.on_grid(self._spectral.inverse_laplacian(value)))

    def flux(self, value: Value, axis: str, transported: Value) -> Value:
        """Return ``(F₊ - F₋)/h`` with the Murman–Roe upwind flux at the cell faces.

        ``F = (f_j + f_{j+1})/2 - sign(a) (f_{j+1} - f_j)/2`` with the wave speed
        ``a = (f_{j+1} - f_j)/(u_{j+1} - u_j)`` of the transported field u
        (LeVeque, Finite Volume Methods for Hyperbolic Problems, §12.2). The upwind direction is
        that of ``∂u/∂t = -∂f/∂x``; an equation with ``+flux(f, x)`` is not stabilised.
        """
        f, dim, h = self._along(value, axis)
        u, _, _ = self._along(transported, axis)
        jump = f.roll(-1, dim) - f
        upwind = torch.sign(jump * (u.roll(-1, dim) - u))
        face = (f + f.roll(-1, dim) - upwind * jump) / 2
        return Value((face - face.roll(1, dim)) / h)

    def _along(self, value: Value, axis: str) -> tuple[Tensor, int, float]:
        index = self.grid.index(axis)
        points = on_whole_grid(self.on_grid(value), self.grid)
        dim = self.grid.dims[index]
        return points, dim, self.grid.axes[index].spacing
