"""Finite volumes on one axis: cells and their faces, as one set of points.

The centres of the cells are the odd points and the faces the even points, at half the distance h of
the cells. Pointwise functions act on all points. A derivative of values at faces is at cells, and
the other way round::

    (∂f/∂x)_j = (f_{j+1} - f_{j-1})/h          at all points but the ends
    (∂f/∂x)_0 = (f_1 - f_0)/(h/2)              at the ends

A second derivative at a cell is therefore the compact ``(f_{j+2} - 2 f_j + f_{j-2})/h²``, and
``∂/∂x (κ ∂f/∂x)`` the difference of the fluxes through the faces, which conserves f. Conditions at
the ends enter through the values of the fields at faces only (:func:`face_values`).
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dashred.physics.grids.grid import Grid
from dashred.physics.grids.grid_value import Value, on_points, on_whole_grid

Array = NDArray[np.float64]


class Staggered:
    """Operators of second order on the cells and faces of one axis."""

    def __init__(self, grid: Grid) -> None:
        self.grid = grid
        [self.axis] = grid.axes
        self._x = grid.coordinates[self.axis.name]

    def on_grid(self, value: Value) -> Tensor | float:
        """Return the field at all points."""
        return on_points(value)

    def derivative(self, value: Value, axis: str, order: int) -> Value:
        """Return ``∂ⁿf/∂xⁿ``, n differences one after another."""
        points = self._points(value)
        for _ in range(order):
            points = self._difference(points)
        return Value(points)

    def laplacian(self, value: Value) -> Value:
        """Return ``∂²f/∂x²``, or ``∂(r ∂f/∂r)/∂r / r`` on a radius."""
        slope = self._difference(self._points(value))
        if not self.axis.radial:
            return Value(self._difference(slope))
        found = self._difference(self._x * slope) / self._x.clamp(min=self.axis.spacing)
        # The centre is a face of area zero; its value is that of the cell beside it.
        return Value(torch.cat([found[..., 1:2], found[..., 1:]], dim=-1))

    def inverse_laplacian(self, value: Value) -> Value:
        """Raise TypeError; :meth:`.declaration.Declaration.parse` accepts none."""
        raise TypeError("finite volumes have no inverse Laplacian")

    def flux(self, value: Value, axis: str, transported: Value) -> Value:
        """Return the difference of the Murman–Roe upwind fluxes through the faces.

        See :meth:`.finite_differences.FiniteDifferences.flux`. The fluxes at the ends follow from
        their conditions.
        """
        f, u = self._points(value), self._points(transported)
        cells, others = f[..., 1::2], u[..., 1::2]
        jump = cells.diff(dim=-1)
        upwind = torch.sign(jump * others.diff(dim=-1))
        inside = (cells[..., 1:] + cells[..., :-1] - upwind * jump) / 2
        faces = torch.cat([f[..., :1], inside, f[..., -1:]], dim=-1)
        found = torch.zeros_like(f)
        found[..., 1::2] = faces.diff(dim=-1) / (2 * self.axis.spacing)
        return Value(found)

    def _points(self, value: Value) -> Tensor:
        return on_whole_grid(self.on_grid(value), self.grid)

    def _difference(self, f: Tensor) -> Tensor:
        half = self.axis.spacing
        ends = (f[..., 1:2] - f[..., :1]) / half, (f[..., -1:] - f[..., -2:-1]) / half
        return torch.cat([ends[0], (f[..., 2:] - f[..., :-2]) / (2 * half), ends[1]], dim=-1)


def face_values(cells: int, h: float, left: str, right: str) -> tuple[Array, dict[str, Array]]:
    """Return how a field at all points follows from its cells and from its conditions.

    It is ``f = P c + Σ_s g_s E_s`` with the values c of the cells and the given values or slopes g.
    A face between two cells has their mean. At an end with a value, f is that value; with a slope s
    it is a straight line from the next cell; with outflow it is extrapolated from two cells.

    Args:
        cells: number of cells.
        h: their size.
        left: kind of the condition at this end: ``value``, ``slope`` or ``outflow``.
        right: kind of the condition at the other end.

    Returns:
        P, ``(point, cell)``, and E of each side, ``(point,)``.
    """
    matrix = np.zeros((2 * cells + 1, cells))
    each = np.arange(cells)
    matrix[2 * each + 1, each] = 1.0
    matrix[2 * each[1:], each[:-1]] = matrix[2 * each[1:], each[1:]] = 0.5
    responses = {}
    for side, kind, outward in (("left", left, -1.0), ("right", right, 1.0)):
        point, first, second = (0, 0, 1) if side == "left" else (-1, -1, -2)
        response = np.zeros(2 * cells + 1)
        if kind == "value":
            response[point] = 1.0
        elif kind == "slope":
            matrix[point, first] = 1.0
            response[point] = outward * h / 2
        else:
            matrix[point, first], matrix[point, second] = 1.5, -0.5
        responses[side] = response
    return matrix, responses
