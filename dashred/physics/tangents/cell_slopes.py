"""Jacobian of the tendency of finite volumes, along a trajectory.

With the semilinear form ``N = L u + Σ_m D_m[G_m(V_i u)]`` it is
``J = L + Σ_m D_m diag(∂G_m/∂v_i) V_i``, with the operators as matrices on cells and faces.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dashred.physics.backends.numpy_backend import Pointwise
from dashred.physics.cells.operator_matrices import OperatorMatrices
from dashred.physics.expressions.algebra import Expr, add
from dashred.physics.expressions.nodes import has_flux
from dashred.physics.expressions.semilinear import Input, NotSemilinearError, semilinear_form
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
        if any(map(has_flux, equations.values())):
            raise NotSemilinearError("an upwind flux")
        self._system, self._matrices = system, OperatorMatrices(system)
        form = semilinear_form(equations, [axis.name for axis in system.axes])
        self._inputs: dict[str, Input] = dict(form.inputs)
        self.size = self._matrices.size
        self._constant = np.zeros((self.size, self.size))
        for field, linear in form.linear.items():
            self._constant += self._matrices.between_cells(add(linear), field, field)
        for equation, couplings in form.couplings.items():
            for field, operator in couplings.items():
                self._constant += self._matrices.between_cells(operator, equation, field)
        self._terms: list[SlopeTerm] = []
        slopes: dict[Expr, int] = {}
        for channel in form.channels:
            for name, slope in form.slopes(channel).items():
                given, equation = form.inputs[name], channel.equation
                rows, columns = map(self._matrices.place, (equation, given.field))
                inner = self._matrices.from_cells(given.operator, given.field)[:, columns]
                outer = self._matrices.to_cells(channel.operator, equation)[rows]
                place = slopes.setdefault(slope, len(slopes))
                self._terms.append(SlopeTerm(rows, columns, place, outer, inner))
        self._slopes = Pointwise(list(slopes))

    def __call__(self, states: Array, t: Array) -> Array:
        """Return J, ``(state, n, n)``, at states ``(state, field, point)`` and times."""
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
            values[name] = field @ self._matrices.at_points(given.operator, given.field).T
        return values
