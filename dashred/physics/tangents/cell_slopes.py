"""Jacobian of the tendency of finite volumes, along a trajectory.

With the semilinear form ``N = L u + Σ_m D_m[G_m(V_i u)]`` it is
``J = L + Σ_m D_m diag(∂G_m/∂v_i) V_i``, with the operators as matrices on cells and faces.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from dashred.physics.backends.numpy_backend import Pointwise
from dashred.physics.backends.torch_backend import Program
from dashred.physics.expressions.algebra import ZERO, Expr, add
from dashred.physics.expressions.nodes import has_flux
from dashred.physics.expressions.semilinear import (
    OPERAND,
    Input,
    NotSemilinearError,
    semilinear_form,
)
from dashred.physics.grids.grid_value import Value
from dashred.physics.system import System

Array = NDArray[np.float64]


class SlopeTerm(NamedTuple):
    """``D diag(∂G/∂v) V`` in one equation, by one field.

    Attributes:
        rows, columns: the cells of the equation and of the field.
        slope: index of ∂G/∂v.
        outer: D at cells, ``(cell, point)``.
        inner: V of the cells, ``(point, cell)``.
    """

    rows: slice
    columns: slice
    slope: int
    outer: Array
    inner: Array


class CellJacobian:
    """J at given states.

    Args:
        system: with a condition for each side of its axis.
        equations: tendency of each field, resolved.

    Raises:
        NotSemilinearError, ArithmeticError: see :func:`.semilinear.semilinear_form`.
    """

    def __init__(self, system: System, equations: Mapping[str, Expr]) -> None:
        self._system, self._matrices = system, system.extension.matrices
        if any(map(has_flux, equations.values())):
            raise NotSemilinearError("an upwind flux")
        form = semilinear_form(equations, [axis.name for axis in system.axes])
        self._inputs: dict[str, Input] = dict(form.inputs)
        self.size = len(system.fields) * self._matrices.shape[2]
        self._constant = np.zeros((self.size, self.size))
        for field, linear in form.linear.items():
            self._add_constant(field, field, add(linear))
        for equation, couplings in form.couplings.items():
            for field, operator in couplings.items():
                self._add_constant(equation, field, operator)
        self._terms: list[SlopeTerm] = []
        slopes: dict[Expr, int] = {}
        for channel in form.channels:
            for name, slope in form.slopes(channel).items():
                given = form.inputs[name]
                index = system.fields.index(given.field)
                inner = self._operator(given.operator) @ self._matrices[index]
                place = slopes.setdefault(slope, len(slopes))
                rows, columns = self._cells(channel.equation), self._cells(given.field)
                outer = self._operator(channel.operator)[1::2]
                self._terms.append(SlopeTerm(rows, columns, place, outer, inner))
        self._slopes = Pointwise(list(slopes))

    def __call__(self, states: Array, t: Array) -> Array:
        """Return J, ``(state, n, n)``, of states ``(state, field, point)`` at times ``(state,)``."""
        found = np.repeat(self._constant[None], len(states), axis=0)
        if not self._terms:
            return found
        slopes = self._slopes(self._values(states, t), states[:, 0].shape)
        for term in self._terms:
            outer = term.outer * slopes[term.slope][:, None, :]
            found[:, term.rows, term.columns] += outer @ term.inner
        return found

    def _values(self, states: Array, t: Array) -> dict[str, Array]:
        """Return the values of all names in slopes, ``(state, point)`` or broadcastable."""
        system, clock = self._system, t[:, None]
        values = {"t": clock, **system.input_signals.at(clock)}
        values |= {name: x.numpy() for name, x in system.grid.places.items()}
        values |= {name: x.numpy() for name, x in system.extension.responses.items()}
        for name, given in self._inputs.items():
            field = states[:, system.fields.index(given.field)]
            values[name] = field @ self._operator(given.operator).T
        return values

    def _add_constant(self, equation: str, field: str, operator: Expr) -> None:
        if operator != ZERO:
            named = self._operator(operator, field)
            matrix = named[1::2] @ self._matrices[self._system.fields.index(field)]
            self._constant[self._cells(equation), self._cells(field)] += matrix

    def _cells(self, field: str) -> slice:
        count, index = self._matrices.shape[2], self._system.fields.index(field)
        return slice(index * count, (index + 1) * count)

    def _operator(self, operator: Expr, field: str = "") -> Array:
        """Return a linear operator on :data:`OPERAND`, or a field, as ``(point, point)``."""
        points = self._matrices.shape[1]
        units = Value(torch.eye(points, dtype=torch.float64))
        operators = self._system.operators
        [value] = Program([operator])({OPERAND.id: units, field: units}, operators)
        columns = torch.as_tensor(operators.on_grid(value), dtype=torch.float64)
        return np.ascontiguousarray(columns.expand(points, points).T.numpy())
