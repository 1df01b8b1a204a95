"""``N(u, t)`` of a batch of spectral states with terms of its own for each, in compiled code."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from dashred.physics.backends.numba_backend import Array, Body, compile_kernel, read_by
from dashred.physics.expressions.algebra import ZERO, Expr
from dashred.physics.expressions.semilinear import (
    OPERAND,
    Input,
    NotSeparableError,
    Separated,
    Separator,
    separate,
)
from dashred.physics.forcing_basis import SampledForcing
from dashred.physics.grids.fourier_symbols import symbols
from dashred.physics.grids.spectral import Spectral
from dashred.physics.grids.transforms import to_modes
from dashred.physics.solvers.batch_coefficients import Columns
from dashred.physics.solvers.compiled_step import Modes, Parts
from dashred.physics.solvers.rhs import two_thirds
from dashred.physics.system import System, Term
from dashred.physics.window import Shape

CPU = torch.device("cpu")


class CompiledTendency:
    """``û' = Lû + N(û, t)``, separated and compiled once.

    The separation is :mod:`dashred.physics.expressions.semilinear`.

    Args:
        system: a spectral system.
        terms: whatever a trajectory may carry, lets and parameters resolved.
        shapes: of the windows in which it may carry them; those that are pointwise alone.

    Raises:
        NotSeparableError, ArithmeticError: as of :func:`semilinear.separate`.
    """

    def __init__(
        self, system: System, terms: Sequence[Term], shapes: tuple[Shape, ...] = ()
    ) -> None:
        assert isinstance(system.operators, Spectral)
        self.columns = Columns(len(terms), shapes)
        self.operators, self.grid = system.operators, system.grid
        self.fields = {field: i for i, field in enumerate(system.fields)}
        axes = [axis.name for axis in system.axes]
        base = separate(system.resolved, axes)
        empty = dict.fromkeys(system.fields, ZERO)
        parts = [separate({**empty, term.equation: term.expression}, axes) for term in terms]
        self._symbols = self._linear_symbols(parts)
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
        if shapes:
            inputs |= self._put_inside(terms, axes)
        derived = {n: v for n, v in inputs.items() if v.operator != OPERAND}
        self._derived = [
            (name, self.fields[v.field], self._symbol(v.operator)) for name, v in derived.items()
        ]
        self._readers = [[b for b in self.bodies if name in read_by([b])] for name in derived]
        self._writers = [
            [b for b in self.bodies if b.channel == c] for c in range(len(self._channels))
        ]
        coordinates = self.grid.places
        read = [*self.fields, *derived]
        self.kernel = compile_kernel(
            self.bodies, read, list(coordinates), self.columns.factors(), system.measured
        )
        shape = self.grid.shape
        points = [np.broadcast_to(x.numpy(), shape).ravel() for x in coordinates.values()]
        self._coordinates = np.array(points)
        self._place = _indices(self.fields[equation] for equation, _ in self._channels)
        outside = [self._symbol(operator) for _, operator in self._channels]
        self._outside = _rows(outside, self._own[0].size)
        self._mask = two_thirds(system).numpy() if system.config.integrator.dealias else None

    def of(self, weights: Array, sampled_forcing: SampledForcing | None = None) -> Weighted:
        """Return N of a batch with weights ``(row, column)`` and a free forcing."""
        return Weighted(self, np.ascontiguousarray(weights), sampled_forcing)

    def _bodies(self, parts: Separated, weight: int | None) -> list[Body]:
        found = []
        for channel in parts.channels:
            if channel.body != ZERO:
                key = channel.equation, channel.operator
                place = self._channels.setdefault(key, len(self._channels))
                found.append(Body(place, channel.body, weight))
        return found

    def _put_inside(self, terms: Sequence[Term], axes: list[str]) -> dict[str, Input]:
        """Let every pointwise term stand within a window, too; return what they read."""
        separator = Separator(frozenset(self.fields), tuple(axes))
        for j, term in enumerate(terms):
            try:
                body = separator.pointwise(term.expression)
            except NotSeparableError:
                continue
            key = term.equation, OPERAND
            place = self._channels.setdefault(key, len(self._channels))
            alike = [b for b in self.bodies if b == Body(place, body, j)]
            for found in alike:
                self.bodies.remove(found)
            weight = j if alike else None
            self.bodies.append(Body(place, body, weight, self.columns.inside(j)))
        return separator.inputs

    def _coupled(
        self, parts: Separated, weight: int | None
    ) -> list[tuple[int, int, Modes, int | None]]:
        return [
            (self.fields[equation], self.fields[field], self._symbol(operator), weight)
            for equation, couplings in parts.couplings.items()
            for field, operator in couplings.items()
        ]

    def _linear_symbols(self, parts: Sequence[Separated]) -> Modes:
        """Return what each term adds to L, ``(term, field, *modes)``."""
        found = [symbols(list(p.linear.values()), self.operators, CPU).numpy() for p in parts]
        *first, last = self.grid.shape
        shape = (len(self.fields), *first, last // 2 + 1)
        return np.array(found).reshape(-1, *shape)

    def _symbol(self, operator: Expr) -> Modes:
        found: Modes = symbols([[operator]], self.operators, CPU)[0].numpy()
        return found


class Weighted:
    """N and L of one batch.

    Attributes:
        linear: L, ``(row, field, *modes)``; of one row, where no trajectory has terms in it.
        parts: N.
        counts: inputs and channels of the kernel.
    """

    def __init__(
        self, compiled: CompiledTendency, weights: Array, sampled_forcing: SampledForcing | None
    ) -> None:
        terms = weights[:, : compiled.columns.terms]
        added = np.tensordot(terms, compiled._symbols, axes=1)
        self.linear = compiled._own + (added if added.any() else np.zeros_like(added[:1]))
        self.counts = len(compiled.fields) + len(compiled._derived), len(compiled._place)
        couplings = compiled._couplings
        modes = self.linear[0, 0].size
        mask = np.ones(modes) if compiled._mask is None else compiled._mask.ravel()
        self.parts = Parts(
            field=_indices(field for _, field, _ in compiled._derived),
            symbol=_rows([symbol for _, _, symbol in compiled._derived], modes),
            active=_active(compiled._readers, weights),
            filled=_active(compiled._writers, weights),
            place=compiled._place,
            outside=compiled._outside,
            to=_indices(equation for equation, *_ in couplings),
            source=_indices(field for _, field, *_ in couplings),
            coupling=_rows([symbol for *_, symbol, _ in couplings], modes),
            strength=np.stack(
                [np.ones(len(weights)) if j is None else weights[:, j] for *_, j in couplings]
                or [np.zeros(0)] * len(weights),
                axis=int(bool(couplings)),
            ),
            mask=mask.astype(np.float64),
            coordinates=compiled._coordinates,
            weights=weights,
            knots=np.zeros(0) if sampled_forcing is None else sampled_forcing.knots.numpy(),
            sampled_forcing=_driven(sampled_forcing, modes),
        )


def _driven(sampled_forcing: SampledForcing | None, modes: int) -> Modes:
    """Return the forcing in modes, ``(row, knot, field, mode)``."""
    if sampled_forcing is None:
        return np.zeros((0, 0, 0, modes), dtype=np.complex128)
    hats = to_modes(sampled_forcing.values.numpy(), sampled_forcing.values.dim() - 3)
    return np.ascontiguousarray(hats.reshape(*hats.shape[:3], modes))


def _active(groups: Sequence[Sequence[Body]], weights: Array) -> NDArray[np.bool_]:
    """Return which trajectories carry a body of each group, ``(row, group)``."""
    active = np.zeros((len(weights), len(groups)), dtype=np.bool_)
    for place, bodies in enumerate(groups):
        for body in bodies:
            columns = [c for c in (body.weight, body.inside) if c is not None]
            active[:, place] |= (weights[:, columns] != 0).any(axis=1) if columns else True
    return active


def _indices(values: Iterable[int]) -> NDArray[np.int64]:
    return np.array(list(values), dtype=np.int64)


def _rows(symbols: Sequence[Modes], modes: int) -> Modes:
    return np.array(symbols, dtype=np.complex128).reshape(-1, modes)
