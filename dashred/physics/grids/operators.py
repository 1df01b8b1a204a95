"""Interface of spatial operators.

:class:`Spectral`, :class:`FiniteDifferences`, :class:`Staggered` and :class:`Scattered` have the
same operations on a :class:`Value`, so that an equation works with each; :class:`NoSpace` is for
ODE systems.
"""

from __future__ import annotations

from typing import Protocol

from torch import Tensor

from dashred.physics.grids.finite_differences import FiniteDifferences
from dashred.physics.grids.grid import Grid
from dashred.physics.grids.grid_value import Value, on_points, total
from dashred.physics.grids.mesh import Mesh
from dashred.physics.grids.scattered import Scattered
from dashred.physics.grids.spectral import Spectral
from dashred.physics.grids.staggered import Staggered

__all__ = [
    "FiniteDifferences",
    "NoSpace",
    "Operators",
    "Scattered",
    "Spectral",
    "Staggered",
    "Value",
    "total",
]


class Operators(Protocol):
    """Spatial operators in an equation."""

    @property
    def grid(self) -> Grid | Mesh:
        """The points of the fields."""

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
    """Operators of an ODE system, in which a field is one number."""

    def __init__(self) -> None:
        self.grid = Grid(())

    def on_grid(self, value: Value) -> Tensor | float:
        """Return the number itself."""
        return on_points(value)

    def derivative(self, value: Value, axis: str, order: int) -> Value:
        """Raise TypeError; the parser accepts no spatial operators for an ODE system."""
        raise TypeError("an ODE system has no spatial operators")

    def laplacian(self, value: Value) -> Value:
        """Raise TypeError."""
        return self.derivative(value, "", 2)

    def inverse_laplacian(self, value: Value) -> Value:
        """Raise TypeError."""
        return self.derivative(value, "", -2)

    def flux(self, value: Value, axis: str, transported: Value) -> Value:
        """Raise TypeError."""
        return self.derivative(value, axis, 1)
