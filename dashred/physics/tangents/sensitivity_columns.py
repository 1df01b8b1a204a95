"""Integrate the columns of a sensitivity along a reference trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dashred.physics.expressions.algebra import Expr
from dashred.physics.grids.transforms import from_modes, to_modes
from dashred.physics.solvers.compiled.step import STAGES
from dashred.physics.solvers.schedule import Step
from dashred.physics.tangents import column_kernels as kernels
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
        self._multipliers = self._flat(tendency.inputs.multipliers[inputs])
        self._channel_symbols = self._flat(tendency.channel_symbols[channels])
        self._channel_equations = np.array(tendency.channel_equations, dtype=int)[channels]
        couplings = [symbol for _, _, symbol in tendency.couplings]
        self._couplings = self._flat(np.array(couplings).reshape(-1, *tendency.mask.shape))
        pairs = [(equation, field) for equation, field, _ in tendency.couplings]
        self._coupled = np.array(pairs, dtype=int).reshape(-1, 2).T.copy()
        self._coefficients = cache(
            lambda h: np.array([self._flat(c) for c in tendency.coefficients(h)])
        )

    def advance(
        self, steps: Sequence[Step], modes: Modes, chunk: range, block: StageBlock
    ) -> tuple[Modes, list[Real]]:
        """Integrate some columns over a block of steps.

        Args:
            steps: the time steps.
            modes: modes of the columns, ``(field, column, *modes)``.
            chunk: indices of the columns.
            block: data of the reference trajectory.

        Returns:
            The final modes and the columns at output times, ``(field, column, *grid)``.
        """
        work = _Chunk(self, modes.shape, chunk)
        outputs = []
        for i, step in enumerate(steps):
            if step.begins:
                modes = self.in_modes(from_modes(modes, self.shape))
            modes = work.step(modes, self._coefficients(step.h), block, STAGES * i)
            if step.ends:
                outputs.append(from_modes(modes, self.shape))
        return modes, outputs

    def in_modes(self, points: Real) -> Modes:
        """Return the modes of columns ``(field, column, *grid)``."""
        mask = self.tendency.mask.astype(points.dtype)
        result: Modes = to_modes(points, len(self.shape)) * mask
        return result

    def _flat(self, symbols: Modes) -> Modes:
        """Flatten symbols ``(item, …, *modes)`` to ``(item, mode)``."""
        return symbols.reshape(len(symbols), self.tendency.mask.size).astype(self.dtype)


class _Chunk:
    """Columns that are integrated together, with their work arrays."""

    def __init__(
        self, integrator: SensitivityIntegrator, shape: tuple[int, ...], chunk: range
    ) -> None:
        self.integrator, self.shape = integrator, shape
        sources = integrator.sources
        symbols = sources.symbols.reshape(len(sources.symbols), integrator.tendency.mask.size)
        self.shifts = select_columns(sources.shifts, chunk)
        self.symbols = symbols[self.shifts[:, 2]].astype(integrator.dtype)
        self.drives = select_columns(sources.drives, chunk)
        fields, columns, size = shape[0], shape[1], integrator.tendency.mask.size
        memory = np.empty((5, fields, columns, size), dtype=integrator.dtype)
        self.n, self.linear, self.rest, self.end, self.stage = memory
        self.spectra = np.empty((len(integrator._fields), columns, size), dtype=integrator.dtype)
        real = np.empty(0, dtype=integrator.dtype).real.dtype
        points = int(np.prod(integrator.shape))
        self.channels = np.empty((len(integrator._channel_equations), columns, points), dtype=real)

    def step(self, modes: Modes, step: Modes, block: StageBlock, at: int) -> Modes:
        """Return the columns after the step whose first stage has index ``at`` in the block."""
        u = np.ascontiguousarray(modes).reshape(self.n.shape)
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
        return result.reshape(self.shape)

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
        kernels.add_rows(block.rows[at], self.drives, self.n)

    def _channels(self, modes: Modes, slopes: Real) -> Modes:
        """Return δG in modes, ``(channel, column, mode)``."""
        integrator = self.integrator
        kernels.gather_products(modes, integrator._multipliers, integrator._fields, self.spectra)
        inputs = from_modes(self.spectra.reshape(-1, *self.shape[1:]), integrator.shape)
        flat = inputs.reshape(*inputs.shape[:2], -1)
        kernels.apply_slopes(flat, slopes, integrator._reads, integrator._writes, self.channels)
        channels = self.channels.reshape(*self.channels.shape[:2], *integrator.shape)
        hats = to_modes(channels, len(integrator.shape))
        return hats.reshape(*hats.shape[:2], -1)


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
