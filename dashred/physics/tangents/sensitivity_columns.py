"""Integrate the columns of a sensitivity along a reference trajectory."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dashred.physics.expressions.algebra import Expr
from dashred.physics.grids.transforms import from_full_modes, to_full_modes
from dashred.physics.solvers.compiled.step import STAGES
from dashred.physics.solvers.schedule import Step
from dashred.physics.tangents import column_kernels as kernels
from dashred.physics.tangents.column_pairs import (
    ColumnPairs,
    full_spectrum,
    power_of_two,
    size_of_modes,
)
from dashred.physics.tangents.semilinear_rhs import Modes, SemilinearTendency
from dashred.physics.tangents.sources import Sources

Real = NDArray[Any]


class StageBlock(NamedTuple):
    """Data of the reference trajectory at the stages of some steps; grid axes are flattened.

    Attributes:
        slopes: ∂G/∂v, ``(stage, slope, point)``.
        rows: source terms of N, ``(stage, row, mode)``.
        shifts: derivatives of the next stage with respect to L, ``(stage, field, mode)``.
    """

    slopes: Real
    rows: Modes
    shifts: Modes


class SensitivityIntegrator:
    """Integrates ``δu' = Lδu + N'(u)δu + θ`` with ETDRK4.

    Attributes:
        slopes: the expressions ∂G/∂v, in the order of ``StageBlock.slopes``.
        linear_terms: symbols of the sources that change L, ``(term, mode)``.
        mask: of the 2/3 rule, ``(mode,)``.
        coefficients: of ETDRK4 for a step length, ``(coefficient, field, mode)``; cached.

    Args:
        tendency: L and N of the equations.
        sources: the sources θ.
        dtype: precision, float32 or float64.
    """

    def __init__(
        self, tendency: SemilinearTendency, sources: Sources, dtype: type[np.floating[Any]]
    ) -> None:
        self.tendency, self.sources = tendency, sources
        self.dtype = np.result_type(dtype, np.complex64)
        self.shape = tendency.inputs.shape
        result = slopes_of(tendency)
        self.slopes: list[Expr] = [slope for _, _, slope in result]
        # Inputs and channels without a slope need no FFT.
        channels, self._writes = renumber([channel for channel, _, _ in result])
        inputs, self._reads = renumber([place for _, place, _ in result])
        self._fields = tendency.inputs.fields[inputs]
        self._multipliers = self._symbols(tendency.inputs.multipliers[inputs])
        self._channel_symbols = self._symbols(tendency.channel_symbols[channels])
        self._channel_equations = np.array(tendency.channel_equations, dtype=int)[channels]
        couplings = [symbol for _, _, symbol in tendency.couplings]
        self._couplings = self._symbols(np.array(couplings))
        pairs = [(equation, field) for equation, field, _ in tendency.couplings]
        self._coupled = np.array(pairs, dtype=int).reshape(-1, 2).T.copy()
        self.mask = self.full(tendency.mask[None])[0].real
        self.linear_terms = self.full(sources.symbols)
        self.coefficients = cache(
            lambda h: np.array([self._symbols(c) for c in tendency.coefficients(h)])
        )

    def begin(self, points: Real, chunk: range, block: StageBlock, span: float) -> Chunk:
        """Return some columns at the first time.

        Args:
            points: their values, ``(field, column, *grid)``.
            chunk: their indices.
            block: data of the reference trajectory over the first steps.
            span: duration of these steps.
        """
        sources = self.sources
        shifts, drives = (select_columns(p, chunk) for p in (sources.shifts, sources.drives))
        axes = (0, *range(2, points.ndim))
        sizes = np.sqrt(np.square(points.astype(np.float64)).mean(axis=axes))
        driven = span * size_of_modes(block.rows[:, drives[:, 2]]).max(axis=0)
        np.maximum.at(sizes, drives[:, 1], driven)
        moved = self.linear_terms[shifts[:, 2]] * block.shifts[:, shifts[:, 0]]
        np.maximum.at(sizes, shifts[:, 1], size_of_modes(moved).max(axis=0))
        return Chunk(self, ColumnPairs(power_of_two(sizes), self.shape), points, drives, shifts)

    def full(self, modes: Modes) -> Modes:
        """Complete modes ``(…, *modes)`` and flatten their axes, in the columns' precision."""
        full = full_spectrum(modes.astype(self.dtype, copy=False), self.shape)
        return full.reshape(*full.shape[: full.ndim - len(self.shape)], math.prod(self.shape))

    def _symbols(self, symbols: Modes) -> Modes:
        """Complete symbols ``(item, …, *modes)`` and flatten them to ``(item, mode)``."""
        return self.full(symbols.reshape(len(symbols), *self.tendency.mask.shape))


class Chunk:
    """Columns that are integrated together, in pairs, with their work arrays.

    Args:
        integrator: of all columns.
        pairs: of these columns.
        points: their values at the first time, ``(field, column, *grid)``.
        drives: places of the rows of sources among them, ``(source, 3)``.
        shifts: places of the linear terms among them, ``(source, 3)``.
    """

    def __init__(
        self,
        integrator: SensitivityIntegrator,
        pairs: ColumnPairs,
        points: Real,
        drives: NDArray[np.int64],
        shifts: NDArray[np.int64],
    ) -> None:
        self.integrator, self.pairs = integrator, pairs
        self.drives, factors = pairs.places(drives)
        self.factors = factors.astype(integrator.dtype)
        self.shifts, factors = pairs.places(shifts)
        symbols = integrator.linear_terms[self.shifts[:, 2]]
        self.symbols = (symbols * factors[:, None]).astype(integrator.dtype)
        fields, size = len(points), math.prod(integrator.shape)
        memory = np.empty((5, fields, pairs.count, size), dtype=integrator.dtype)
        self.n, self.linear, self.rest, self.end, self.stage = memory
        inputs = len(integrator._fields), pairs.count, size
        self.spectra = np.empty(inputs, dtype=integrator.dtype)
        channels = len(integrator._channel_equations), pairs.count, size
        self.channels = np.empty(channels, dtype=integrator.dtype)
        modes = pairs.to_modes(points).reshape(self.n.shape)
        self.modes: Modes = modes * integrator.mask

    def advance(self, steps: Sequence[Step], block: StageBlock) -> list[Real]:
        """Integrate over a block of steps.

        Args:
            steps: the time steps.
            block: data of the reference trajectory.

        Returns:
            The columns at output times, ``(field, column, *grid)``.
        """
        outputs = []
        for i, step in enumerate(steps):
            self.modes = self._step(self.integrator.coefficients(step.h), block, STAGES * i)
            if step.ends:
                shape = *self.n.shape[:2], *self.integrator.shape
                outputs.append(self.pairs.to_points(self.modes.reshape(shape)))
        return outputs

    def _step(self, step: Modes, block: StageBlock, at: int) -> Modes:
        """Return the columns after the step whose first stage has index ``at`` in the block."""
        u = self.modes
        _, _, q, _, middle, last = step
        self._tendency(u, block, at)
        kernels.first_stage(u, self.n, step, self.linear, self.rest, self.end, self.stage)
        self._shift(self.stage, block, at)
        self._tendency(self.stage, block, at + 1)
        kernels.middle_stage(self.linear, self.n, q, middle, self.end, self.stage)
        self._shift(self.stage, block, at + 1)
        self._tendency(self.stage, block, at + 2)
        kernels.middle_stage(self.rest, self.n, 2 * q, middle, self.end, self.stage)
        self._shift(self.stage, block, at + 2)
        self._tendency(self.stage, block, at + 3)
        result = np.empty_like(u)
        kernels.last_stage(self.end, self.n, last, result)
        self._shift(result, block, at + 3)
        return result

    def _shift(self, modes: Modes, block: StageBlock, at: int) -> None:
        kernels.add_shifts(self.symbols, block.shifts[at], self.shifts, modes)

    def _tendency(self, modes: Modes, block: StageBlock, at: int) -> None:
        """Set ``n`` to ``N'δu + θ``."""
        integrator = self.integrator
        self.n[...] = 0
        if len(integrator.slopes):
            hats = self._channels(modes, block.slopes[at])
            order = np.arange(len(hats))
            kernels.add_products(
                integrator._channel_symbols, hats, order, integrator._channel_equations, self.n
            )
        equations, fields = integrator._coupled
        kernels.add_products(integrator._couplings, modes, fields, equations, self.n)
        kernels.add_rows(block.rows[at], self.drives, self.factors, self.n)

    def _channels(self, modes: Modes, slopes: Real) -> Modes:
        """Return δG in modes, ``(channel, pair, mode)``."""
        integrator = self.integrator
        kernels.gather_products(modes, integrator._multipliers, integrator._fields, self.spectra)
        grid = integrator.shape
        inputs = from_full_modes(self.spectra.reshape(-1, *self.n.shape[1:2], *grid), len(grid))
        parts = (_both_parts(each.reshape(*each.shape[:2], -1)) for each in (inputs, self.channels))
        values, channels = parts
        kernels.apply_slopes(values, slopes, integrator._reads, integrator._writes, channels)
        hats = to_full_modes(self.channels.reshape(*self.channels.shape[:2], *grid), len(grid))
        return hats.reshape(*hats.shape[:2], -1)


def _both_parts(values: Modes) -> Real:
    """Return real and imaginary parts in turn, ``(…, 2 point)``; the same memory."""
    return values.view(values.real.dtype)


def slopes_of(tendency: SemilinearTendency) -> list[tuple[int, int, Expr]]:
    """Return the channel, the input and the expression of each slope ∂G/∂v."""
    return [
        (channel, tendency.inputs.names.index(name), slope)
        for channel, part in enumerate(tendency.form.channels)
        for name, slope in tendency.form.slopes(part).items()
    ]


def renumber(places: list[int]) -> tuple[list[int], NDArray[np.int64]]:
    """Return the sorted distinct places, and the index of each place among them."""
    different = sorted(set(places))
    return different, np.array([different.index(place) for place in places], dtype=np.int64)


def select_columns(places: Sequence[tuple[int, int, int]], chunk: range) -> NDArray[np.int64]:
    """Return the places in a chunk of columns, with column indices relative to the chunk."""
    result = [(e, column - chunk.start, i) for e, column, i in places if column in chunk]
    return np.array(result, dtype=np.int64).reshape(-1, 3)
