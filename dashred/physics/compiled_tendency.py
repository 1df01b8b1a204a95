"""``N(u, t)`` of a batch of spectral states with terms of its own for each, in compiled code."""

from __future__ import annotations

from collections.abc import Sequence

import numba
import numpy as np
import torch
from numpy.typing import NDArray

from dashred.physics.algebra import ZERO, Expr
from dashred.physics.kernel import Array, Body, compile_kernel, read_by
from dashred.physics.linear import is_linear, symbols
from dashred.physics.linearisation import OPERAND, Input, Separated, separate
from dashred.physics.spectral import Spectral
from dashred.physics.system import System, Term
from dashred.physics.tendency import two_thirds
from dashred.physics.transforms import from_modes, to_modes

Modes = NDArray[np.complex128]
CPU = torch.device("cpu")


class CompiledTendency:
    """``û' = Lû + N(û, t)``, separated (:mod:`dashred.physics.linearisation`) and compiled once.

    Args:
        system: a spectral system.
        terms: whatever a trajectory may carry, lets and parameters resolved.

    Raises:
        NotSeparableError, ArithmeticError: see :func:`dashred.physics.linearisation.separate`.
    """

    def __init__(self, system: System, terms: Sequence[Term]) -> None:
        assert isinstance(system.operators, Spectral)
        self.operators, self.grid = system.operators, system.grid
        self.fields = {field: i for i, field in enumerate(system.fields)}
        axes = [axis.name for axis in system.axes]
        base = separate(system.resolved, axes)
        empty = dict.fromkeys(system.fields, ZERO)
        self.linear_terms = [is_linear(term.expression, term.equation) for term in terms]
        parts = [
            separate(empty if linear else {**empty, term.equation: term.expression}, axes)
            for term, linear in zip(terms, self.linear_terms, strict=True)
        ]
        self._symbols = self._linear_symbols(system, terms)
        self._own = symbols(list(base.linear.values()), self.operators, CPU).numpy()
        self._channels: dict[tuple[str, Expr], int] = {}
        self.bodies = [*self._bodies(base, None)]
        for j, part in enumerate(parts):
            self.bodies += self._bodies(part, j)
        self._couplings = [*self._coupled(base, None)]
        for j, part in enumerate(parts):
            self._couplings += self._coupled(part, j)
        inputs: dict[str, Input] = dict(base.inputs)
        for part in parts:
            inputs |= part.inputs
        derived = {n: v for n, v in inputs.items() if v.operator != OPERAND}
        self._derived = [
            (name, place, self.fields[v.field], self._symbol(v.operator))
            for place, (name, v) in enumerate(derived.items(), start=len(self.fields))
        ]
        coordinates = self.grid.coordinates
        self._kernel = compile_kernel(self.bodies, [*self.fields, *derived], list(coordinates))
        shape = self.grid.shape
        points = [np.broadcast_to(x.numpy(), shape).ravel() for x in coordinates.values()]
        self._coordinates = np.array(points)
        self._place = np.array([self.fields[equation] for equation, _ in self._channels])
        self._outside = np.array([self._symbol(operator) for _, operator in self._channels])
        self._outside = self._outside.reshape(len(self._place), -1)
        self._mask = two_thirds(system).numpy() if system.config.integrator.dealias else None

    def of(self, weights: Array) -> Weighted:
        """Return N of a batch with coefficients ``(row, term)``."""
        return Weighted(self, np.ascontiguousarray(weights))

    def _bodies(self, parts: Separated, weight: int | None) -> list[Body]:
        found = []
        for channel in parts.channels:
            if channel.body != ZERO:
                key = channel.equation, channel.operator
                place = self._channels.setdefault(key, len(self._channels))
                found.append(Body(place, channel.body, weight))
        return found

    def _coupled(
        self, parts: Separated, weight: int | None
    ) -> list[tuple[int, int, Modes, int | None]]:
        return [
            (self.fields[equation], self.fields[field], self._symbol(operator), weight)
            for equation, couplings in parts.couplings.items()
            for field, operator in couplings.items()
        ]

    def _linear_symbols(self, system: System, terms: Sequence[Term]) -> Modes:
        """Return what each linear term adds to L, ``(term, field, *modes)``."""
        found = []
        for term, linear in zip(terms, self.linear_terms, strict=True):
            own = [[term.expression] if linear and f == term.equation else [] for f in self.fields]
            found.append(symbols(own, self.operators, CPU).numpy())
        *first, last = self.grid.shape
        shape = (len(self.fields), *first, last // 2 + 1)
        return np.array(found).reshape(-1, *shape)

    def _symbol(self, operator: Expr) -> Modes:
        found: Modes = symbols([[operator]], self.operators, CPU)[0].numpy()
        return found


class Weighted:
    """N and L of one batch.

    Attributes:
        linear: L, ``(row, field, *modes)``.
    """

    def __init__(self, compiled: CompiledTendency, weights: Array) -> None:
        self.compiled, self.weights = compiled, weights
        self.linear = compiled._own + np.tensordot(weights, compiled._symbols, axes=1)
        carried = (weights != 0).any(axis=0)
        mine = [b for b in compiled.bodies if b.weight is None or carried[b.weight]]
        self.derived = [
            (place, field, symbol, self._rows(name, mine))
            for name, place, field, symbol in compiled._derived
            if name in read_by(mine)
        ]
        ones = np.ones(len(weights))
        self.couplings = [
            (equation, field, symbol.ravel(), ones if weight is None else weights[:, weight].copy())
            for equation, field, symbol, weight in compiled._couplings
            if weight is None or carried[weight]
        ]
        points = int(np.prod(compiled.grid.shape))
        count = len(compiled.fields) + len(compiled._derived)
        self.inputs = np.zeros((count, len(weights), points))
        self.channels = np.empty((len(compiled._place), len(weights), points))

    def __call__(self, modes: Modes, t: float) -> Modes:
        """Return N in modes, ``(row, field, *modes)``."""
        compiled = self.compiled
        shape, rows = compiled.grid.shape, len(modes)
        fields = from_modes(modes, shape).reshape(rows, len(compiled.fields), -1)
        self.inputs[: len(compiled.fields)] = fields.swapaxes(0, 1)
        for place, field, symbol, mine in self.derived:
            applied = symbol * modes[mine, field]
            self.inputs[place, mine] = from_modes(applied, shape).reshape(len(applied), -1)
        compiled._kernel(self.inputs, compiled._coordinates, t, self.weights, self.channels)
        hats = to_modes(self.channels.reshape(-1, rows, *shape), len(shape))
        found = np.zeros_like(modes)
        _assemble(
            hats.reshape(len(compiled._place), rows, -1),
            compiled._outside,
            compiled._place,
            found.reshape(rows, modes.shape[1], -1),
        )
        flat = modes.reshape(rows, modes.shape[1], -1), found.reshape(rows, modes.shape[1], -1)
        for equation, field, symbol, weight in self.couplings:
            _couple(*flat, symbol, weight, equation, field)
        return self.kept(found)

    def kept(self, modes: Modes) -> Modes:
        """Return the modes that the 2/3 rule keeps: all of them unless it was asked for."""
        mask = self.compiled._mask
        return modes if mask is None else modes * mask

    def _rows(self, name: str, bodies: Sequence[Body]) -> NDArray[np.int64] | slice:
        reading = [body for body in bodies if name in read_by([body])]
        columns = [body.weight for body in reading if body.weight is not None]
        if len(columns) < len(reading):
            return slice(None)
        return np.flatnonzero((self.weights[:, columns] != 0).any(axis=1))


@numba.njit(cache=True)
def _assemble(hats: Modes, symbols: Modes, places: NDArray[np.int64], out: Modes) -> None:
    for channel in range(hats.shape[0]):
        field = places[channel]
        for row in range(hats.shape[1]):
            for k in range(hats.shape[2]):
                out[row, field, k] += symbols[channel, k] * hats[channel, row, k]


@numba.njit(cache=True)
def _couple(
    modes: Modes, out: Modes, symbol: Modes, weights: Array, equation: int, field: int
) -> None:
    for row in range(modes.shape[0]):
        if weights[row] != 0.0:
            for k in range(modes.shape[2]):
                out[row, equation, k] += weights[row] * symbol[k] * modes[row, field, k]
