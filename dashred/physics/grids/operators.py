"""What an equation needs of space: one interface, three kinds of grids.

:class:`Spectral` and :class:`FiniteDifferences` offer the same operations on a
:class:`Value`, so an equation runs on either; :class:`NoSpace` serves ODE systems.
"""

from __future__ import annotations

from typing import Protocol

from torch import Tensor

from dashred.physics.grids.finite_differences import FiniteDifferences
from dashred.physics.grids.grid import Grid
from dashred.physics.grids.grid_value import Value, on_points, total
from dashred.physics.grids.spectral import Spectral

__all__ = ["FiniteDifferences", "NoSpace", "Operators", "Spectral", "Value", "total"]


class Operators(Protocol):
    """What an equation needs of space."""

    grid: Grid

    def on_grid(self, value: Value) -> Tensor | float:
        """Return the field on the grid."""

    def derivative(self, value: Value, axis: str, order: int) -> Value:
        """Return ``∂ⁿf/∂xⁿ``."""

    def laplacian(self, value: Value) -> Value:
        """Return ``∇²f``."""

    def inverse_laplacian(self, value: Value) -> Value:
        """Return the zero-mean solution g of ``∇²g = f - mean(f)``."""

    def flux(self, value: Value, axis: str, transported: Value) -> Value:
        """Return the conservative derivative ``∂f/∂x`` of a flux of the transported field."""


class NoSpace:
    """The operators of an ODE system: a field is one number."""

    def __init__(self) -> None:
        self.grid = Grid(())

    def on_grid(self, value: Value) -> Tensor | float:
        """Return the number itself."""
        return on_points(value)

    def derivative(self, value: Value, axis: str, order: int) -> Value:
        """Refuse: the parser lets no spatial operator through."""
        raise TypeError("an ODE system has no spatial operators")

    def laplacian(self, value: Value) -> Value:
        """Refuse."""
        return self.derivative(value, "", 2)

    def inverse_laplacian(self, value: Value) -> Value:
        """Refuse."""
        return self.derivative(value, "", -2)

    def flux(self, value: Value, axis: str, transported: Value) -> Value:
        """Refuse."""
        return self.derivative(value, axis, 1)
