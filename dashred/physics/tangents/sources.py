"""Sources of the columns of a sensitivity: terms evaluated along a trajectory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
import torch
from torch import Tensor

from dashred.physics.backends.numpy_backend import Array
from dashred.physics.backends.torch_backend import Program
from dashred.physics.expressions.algebra import ZERO, Expr, add
from dashred.physics.expressions.linear import split_linear
from dashred.physics.expressions.semilinear import NotSemilinearError, SemilinearBuilder
from dashred.physics.forcing_basis import ForcingBasis
from dashred.physics.grids.grid_value import Value, on_whole_grid
from dashred.physics.grids.transforms import points_of, to_modes
from dashred.physics.system import System, Term
from dashred.physics.tangents.semilinear_rhs import Inputs, Modes, mode_mask, operator_symbol

Places = list[tuple[int, int, int]]


class Sources:
    """Sources ``Σ_{θ in sources[k]} θ(u)`` of each equation.

    A term that is linear in the field of its equation changes L, as it does in the equations. The
    other terms are sources of N. A term in several equations is evaluated once.

    Attributes:
        shifts: ``(equation, column, i)`` for linear term i.
        symbols: Fourier symbols of the linear terms, ``(i, *modes)``.
        drives: ``(equation, column, row)`` for each row of the result of a call.
        bodies: the pointwise functions of the rows; the caller evaluates them.
        channels: ``(row, i, D)`` if a row contains ``D[G_i]``, for body i, or after the bodies for
            a term without a semilinear form.
        couplings: ``(row, field, C)`` if a row contains ``C f``.
        bumps: modes of the bumps of the forcing basis, ``(cell, *modes)``.
        inputs: the inputs of the bodies.

    Args:
        system: the simulator.
        sources: terms of each column, with lets and parameters resolved.
        first: index of the first of these columns.
        forcing_basis: basis of a free forcing; one further column for each coefficient.
    """

    def __init__(
        self,
        system: System,
        sources: Sequence[tuple[Term, ...]],
        first: int,
        forcing_basis: ForcingBasis | None = None,
    ) -> None:
        self.system = system
        self.shifts: Places = []
        self.drives: Places = []
        symbols: list[Modes] = []
        rows: dict[Expr, int] = {}
        for (equation, column), expr in _by_place(sources, first).items():
            place = system.fields.index(equation), column
            linear, rest = split_linear(expr, equation)
            if linear:
                self.shifts.append((*place, len(symbols)))
                symbols.append(operator_symbol(system, add(linear)))
            if rest != ZERO:
                self.drives.append((*place, rows.setdefault(rest, len(rows))))
        mask = mode_mask(system)
        self.symbols = np.array(symbols).reshape(-1, *mask.shape)
        self.rows, self._mask = len(rows), mask
        self._separate(rows)
        self.forcing_basis = forcing_basis
        if forcing_basis is not None:
            self._add_forcing_basis(forcing_basis, first + len(sources))

    def _add_forcing_basis(self, forcing_basis: ForcingBasis, first: int) -> None:
        """Add the columns of the basis; all equations share one row for each cell and course."""
        fields, cells, courses = forcing_basis.shape
        places = product(range(fields), range(cells * courses))
        self.drives += [(e, column, self.rows + i) for column, (e, i) in enumerate(places, first)]
        self.bumps = self._mask * to_modes(forcing_basis.bumps.numpy(), self._mask.ndim)

    def __call__(
        self, values: Array, modes: Modes, times: Array, dtype: type[np.floating[Any]]
    ) -> Modes:
        """Return the rows in modes, ``(row, time, *modes)``.

        Args:
            values: values of the bodies on the grid, ``(body, time, *grid)``.
            modes: modes of the fields, ``(field, time, *modes)``.
            times: ``(time, 1, …)`` with a 1 for each axis of the grid.
            dtype: precision of the result.
        """
        hats = self._to_modes(values, modes, times, dtype)
        modes = modes.astype(np.result_type(dtype, np.complex64))
        result = np.zeros((self.rows, *modes.shape[1:]), dtype=modes.dtype)
        for row, body, symbol in self.channels:
            result[row] += hats[body] * symbol.astype(modes.dtype)
        for row, field, symbol in self.couplings:
            result[row] += modes[field] * symbol.astype(modes.dtype)
        if self.forcing_basis is None:
            return result
        hats = self.forcing_basis.hats(times.ravel())
        basis_rows = np.einsum("tk,c...->ckt...", hats, self.bumps).astype(result.dtype)
        return np.concatenate((result, basis_rows.reshape(-1, *result.shape[1:])))

    def _to_modes(
        self, values: Array, modes: Modes, times: Array, dtype: type[np.floating[Any]]
    ) -> Modes:
        points = values.astype(dtype)
        if self.has_others:
            others = self.evaluate_others(torch.from_numpy(modes), times).numpy()
            points = np.concatenate((points, others.astype(dtype)))
        return to_modes(points, len(self.system.grid.shape)) if len(points) else points

    def _separate(self, rows: Mapping[Expr, int]) -> None:
        fields, axes = self.system.fields, [axis.name for axis in self.system.axes]
        builder = SemilinearBuilder(frozenset(fields), tuple(axes))
        bodies: dict[Expr, int] = {}
        others: dict[Expr, int] = {}
        self.channels: list[tuple[int, int, Modes]] = []
        self.couplings: list[tuple[int, int, Modes]] = []
        for expr, row in rows.items():
            try:
                couplings, channels = builder.equation("", expr)
            except NotSemilinearError:
                others[expr] = row
                continue
            for field, operator in couplings.items():
                self.couplings.append((row, fields.index(field), self._symbol(operator)))
            for channel in channels:
                if channel.body != ZERO:
                    body = bodies.setdefault(channel.body, len(bodies))
                    self.channels.append((row, body, self._symbol(channel.operator)))
        for body, row in enumerate(others.values(), len(bodies)):
            self.channels.append((row, body, self._mask.astype(complex)))
        self.bodies, self.inputs = list(bodies), Inputs(self.system, builder.inputs)
        self._others = Program(list(others)) if others else None

    def _symbol(self, operator: Expr) -> Modes:
        result: Modes = self._mask * operator_symbol(self.system, operator)
        return result

    @property
    def has_others(self) -> bool:
        """Whether there are terms without a semilinear form."""
        return self._others is not None

    def evaluate_others(self, hats: Tensor, times: Array) -> Tensor:
        """Return the terms without a semilinear form, ``(term, time, *grid)``.

        Args:
            hats: modes of the fields, ``(field, time, *modes)``.
            times: ``(time, 1, …)`` with a 1 for each axis of the grid.
        """
        assert self._others is not None
        system = self.system
        points = points_of(hats, system.grid.shape)
        values = system.coordinates_and_inputs(times, hats.device)
        values |= dict(zip(system.fields, map(Value, points, hats), strict=True))
        result = (system.operators.on_grid(v) for v in self._others(values, system.operators))
        shape = (hats.shape[1], *system.grid.shape)
        rows = [on_whole_grid(f, system.grid).to(points).expand(shape) for f in result]
        return torch.stack(rows)


def _by_place(sources: Sequence[tuple[Term, ...]], first: int) -> dict[tuple[str, int], Expr]:
    result: dict[tuple[str, int], list[Expr]] = {}
    for column, terms in enumerate(sources, first):
        for term in terms:
            result.setdefault((term.equation, column), []).append(term.expression)
    return {place: add(terms) for place, terms in result.items()}
