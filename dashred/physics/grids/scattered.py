"""Derivatives on scattered nodes, by local stencils."""

from __future__ import annotations

from torch import Tensor

from dashred.physics.grids.grid_value import Value, on_points, on_whole_grid
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
        return self._weighted(value, tuple(powers))

    def laplacian(self, value: Value) -> Value:
        """Return the sum of second derivatives."""
        return self._weighted(value, ())

    def inverse_laplacian(self, value: Value) -> Value:
        """Raise TypeError; :meth:`.declaration.Declaration.parse` accepts none."""
        raise TypeError("scattered nodes have no inverse Laplacian")

    def flux(self, value: Value, axis: str, transported: Value) -> Value:
        """Return ``∂f/∂x``: the stencils are not upwind."""
        return self.derivative(value, axis, 1)

    def _weighted(self, value: Value, order: tuple[int, ...]) -> Value:
        points = on_whole_grid(self.on_grid(value), self.grid)
        flat = points.reshape(-1, points.shape[-1])
        return Value((self.grid.derivatives[order] @ flat.T).T.reshape(points.shape))
