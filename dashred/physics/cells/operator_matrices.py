"""Linear operators on cells and faces, as matrices."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from dashred.physics.backends.torch_backend import Program
from dashred.physics.expressions.algebra import Expr, add
from dashred.physics.expressions.linear import split_linear
from dashred.physics.expressions.semilinear import OPERAND
from dashred.physics.grids.grid_value import Value
from dashred.physics.system import System, Term

Array = NDArray[np.float64]


class OperatorMatrices:
    """Matrices between the cells of all fields, in the order of the state, and points.

    The cells are ``n = field·cell`` numbers; there are ``point`` cells and faces.

    Args:
        system: with a condition for each side of its axis.
    """

    def __init__(self, system: System) -> None:
        self._operators, self._fields = system.operators, system.fields
        self._faces = system.extension.matrices
        self.points, self.cells = self._faces.shape[1:]
        self.size = len(self._fields) * self.cells
        self._found: dict[tuple[Expr, str], Array] = {}

    def at_points(self, operator: Expr, field: str) -> Array:
        """Return an operator on :data:`OPERAND`, or on the field, as ``(point, point)``."""
        key = operator, field
        if key not in self._found:
            units = Value(torch.eye(self.points, dtype=torch.float64))
            [value] = Program([operator])({OPERAND.id: units, field: units}, self._operators)
            columns = torch.as_tensor(self._operators.on_grid(value), dtype=torch.float64)
            whole = columns.expand(self.points, self.points)
            self._found[key] = np.ascontiguousarray(whole.T.numpy())
        return self._found[key]

    def from_cells(self, operator: Expr, field: str) -> Array:
        """Return an operator on a field from its cells alone, ``(point, n)``."""
        result = np.zeros((self.points, self.size))
        faces = self._faces[self._fields.index(field)]
        result[:, self.place(field)] = self.at_points(operator, field) @ faces
        return result

    def to_cells(self, operator: Expr, equation: str) -> Array:
        """Return an operator whose result is the tendency of an equation, ``(n, point)``."""
        result = np.zeros((self.size, self.points))
        result[self.place(equation)] = self.at_points(operator, equation)[1::2]
        return result

    def between_cells(self, operator: Expr, equation: str, field: str) -> Array:
        """Return an operator on a field in an equation, ``(n, n)``."""
        result = np.zeros((self.size, self.size))
        result[self.place(equation)] = self.from_cells(operator, field)[1::2]
        return result

    def place(self, field: str) -> slice:
        """Return the cells of a field."""
        index = self._fields.index(field)
        return slice(index * self.cells, (index + 1) * self.cells)


def fastest_linear_rate(system: System, terms: Sequence[Term]) -> float:
    """Return a bound of the rate at which the linear part of terms changes the cells.

    It is the largest sum of absolute entries in a row of its matrix.

    Args:
        system: with a condition for each side of its axis.
        terms: resolved.
    """
    matrices, fastest = OperatorMatrices(system), 0.0
    for term in terms:
        for field in system.fields:
            linear, _ = split_linear(term.expression, field)
            if linear:
                matrix = matrices.between_cells(add(linear), term.equation, field)
                fastest = max(fastest, float(np.abs(matrix).sum(axis=1).max()))
    return fastest
