"""Derivatives on scattered nodes, by local stencils."""

from __future__ import annotations

import torch
from torch import Tensor

from dashred.physics.grids.grid_value import Value, on_points, on_whole_grid, total
from dashred.physics.grids.mesh import Mesh


class Scattered:
    """First and second derivatives of polyharmonic splines (:mod:`.stencils`)."""

    def __init__(self, grid: Mesh) -> None:
        self.grid = grid

    def on_grid(self, value: Value) -> Tensor | float:
        """Return the field at the nodes."""
        return on_points(value)

    def derivative(self, value: Value, axis: str, order: int) -> Value:
        """Return ``∂ⁿf/∂xⁿ``, for n up to 2."""
        powers = [0] * len(self.grid.names)
        powers[self.grid.index(axis)] = order
        points = on_whole_grid(self.on_grid(value), self.grid)
        flat = points.reshape(-1, points.shape[-1])
        found = torch.sparse.mm(self.grid.derivatives[tuple(powers)], flat.T).T
        return Value(found.reshape(points.shape))

    def laplacian(self, value: Value) -> Value:
        """Return the sum of second derivatives."""
        return total([self.derivative(value, name, 2) for name in self.grid.names])

    def inverse_laplacian(self, value: Value) -> Value:
        """Raise TypeError; :meth:`.declaration.Declaration.parse` accepts none."""
        raise TypeError("scattered nodes have no inverse Laplacian")

    def flux(self, value: Value, axis: str, transported: Value) -> Value:
        """Return ``∂f/∂x``: the stencils are not upwind."""
        return self.derivative(value, axis, 1)
