"""Integrate the columns of a sensitivity along a reference trajectory."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dashred.physics.expressions.algebra import Expr
from dashred.physics.grids.full_spectrum import full_spectrum
from dashred.physics.grids.transforms import from_full_modes, to_full_modes
from dashred.physics.solvers.compiled.step import STAGES
from dashred.physics.solvers.schedule import Step
from dashred.physics.tangents import column_kernels as kernels
from dashred.physics.tangents.column_pairs import (
    ColumnPairs,
    power_of_two,
    size_of_modes,
)
from dashred.physics.tangents.semilinear_rhs import Modes, SemilinearTendency
from dashred.physics.tangents.sources import Sources

Real = NDArray[Any]

# Modes between others that are computed although they are zero: short loops are slow.
GAP = 64


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
        reads, writes: index of the input and of the channel of each slope.
        equations: the linearised equations.
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
        channels, self.writes = renumber([channel for channel, _, _ in result])
        inputs, self.reads = renumber([place for _, place, _ in result])
        couplings = [symbol for _, _, symbol in tendency.couplings]
        pairs = [(equation, field) for equation, field, _ in tendency.couplings]
        self.mask = self.full(tendency.mask[None])[0].real
        self.equations = kernels.Equations(
            tiles=_tiles(self.mask),
            channels=np.array(tendency.channel_equations, dtype=np.int64)[channels],
            channel_symbols=self._symbols(tendency.channel_symbols[channels]),
            coupled=np.array(pairs, dtype=np.int64).reshape(-1, 2),
            couplings=self._symbols(np.array(couplings)),
            inputs=tendency.inputs.fields[inputs],
            multipliers=self._symbols(tendency.inputs.multipliers[inputs]),
        )
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
        pairs = ColumnPairs(power_of_two(sizes), self.shape)
        return Chunk(self, pairs, points, self._of_pairs(pairs, drives, shifts))

    def full(self, modes: Modes) -> Modes:
        """Complete modes ``(…, *modes)`` and flatten their axes, in the columns' precision."""
        full = full_spectrum(modes, self.shape, self.dtype)
        return full.reshape(*full.shape[: full.ndim - len(self.shape)], math.prod(self.shape))

    def _symbols(self, symbols: Modes) -> Modes:
        """Complete symbols ``(item, …, *modes)`` and flatten them to ``(item, mode)``."""
        return self.full(symbols.reshape(len(symbols), *self.tendency.mask.shape))

    def _of_pairs(
        self, pairs: ColumnPairs, drives: NDArray[np.int64], shifts: NDArray[np.int64]
    ) -> kernels.PairSources:
        """Return the sources of pairs, given their places ``(equation, column, index)``."""
        fields = len(self.tendency.linear)
        first_drive, rows, factors = _by_pair(pairs, drives, fields)
        first_shift, terms, scales = _by_pair(pairs, shifts, fields)
        symbols = self.linear_terms[terms] * scales[:, None]
        return kernels.PairSources(
            first_drive, rows, factors.astype(self.dtype), first_shift, symbols.astype(self.dtype)
        )


class Chunk:
    """Columns that are integrated together, in pairs, with their work arrays.

    Args:
        integrator: of all columns.
        pairs: of these columns.
        points: their values at the first time, ``(field, column, *grid)``.
        sources: of these pairs.
    """

    def __init__(
        self,
        integrator: SensitivityIntegrator,
        pairs: ColumnPairs,
        points: Real,
        sources: kernels.PairSources,
    ) -> None:
        self.integrator, self.pairs, self.sources = integrator, pairs, sources
        size = math.prod(integrator.shape)
        modes = pairs.to_modes(points).reshape(len(points), pairs.count, size) * integrator.mask
        self.modes: Modes = modes
        # Modes that the 2/3 rule removes are never written, and stay zero.
        self.end, *self.stages = np.zeros((4, *modes.shape), dtype=integrator.dtype)
        inputs, channels = len(integrator.equations.inputs), len(integrator.equations.channels)
        self.spectra = np.zeros((inputs, pairs.count, size), dtype=integrator.dtype)
        self.channels = np.empty((channels, pairs.count, size), dtype=integrator.dtype)
        kernels.gather_inputs(integrator.equations, self.modes, self.spectra)

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
            self._step(self.integrator.coefficients(step.h), block, STAGES * i)
            if step.ends:
                shape = *self.modes.shape[:2], *self.integrator.shape
                outputs.append(self.pairs.to_points(self.modes.reshape(shape)))
        return outputs

    def _step(self, step: Modes, block: StageBlock, at: int) -> None:
        """Advance by the step whose first stage has index ``at`` in the block."""
        u, end, (a, b, c), spectra = self.modes, self.end, self.stages, self.spectra
        _, _, q, _, middle, last = step
        own, rows, shifts = (self.integrator.equations, self.sources), block.rows, block.shifts
        slopes = block.slopes
        hats = self._channels(slopes[at])
        kernels.first_stage(own, rows[at], shifts[at], hats, step, u, a, b, c, end, spectra)
        at += 1
        hats = self._channels(slopes[at])
        kernels.middle_stage(own, rows[at], shifts[at], hats, q, middle, a, b, end, spectra)
        at += 1
        hats = self._channels(slopes[at])
        kernels.middle_stage(own, rows[at], shifts[at], hats, 2 * q, middle, b, c, end, spectra)
        at += 1
        hats = self._channels(slopes[at])
        kernels.last_stage(own, rows[at], shifts[at], hats, last, c, end, spectra)
        self.modes, self.end = end, u

    def _channels(self, slopes: Real) -> Modes:
        """Return δG in modes, ``(channel, pair, mode)``, given the inputs in modes."""
        integrator = self.integrator
        if not len(integrator.slopes):
            return self.channels
        grid = integrator.shape
        inputs = from_full_modes(self.spectra.reshape(*self.spectra.shape[:2], *grid), len(grid))
        parts = (_both_parts(each.reshape(*each.shape[:2], -1)) for each in (inputs, self.channels))
        values, channels = parts
        kernels.apply_slopes(values, slopes, integrator.reads, integrator.writes, channels)
        hats = to_full_modes(self.channels.reshape(*self.channels.shape[:2], *grid), len(grid))
        return hats.reshape(*hats.shape[:2], -1)


def _both_parts(values: Modes) -> Real:
    """Return real and imaginary parts in turn, ``(…, 2 point)``; the same memory."""
    return values.view(values.real.dtype)


def _tiles(mask: Real) -> NDArray[np.int64]:
    """Return the first mode of each tile and the one after its last, ``(tile, 2)``.

    The tiles cover all modes of a mask ``(mode,)``, and gaps of at most :data:`GAP`.
    """
    kept = np.flatnonzero(mask)
    parts = np.split(kept, np.flatnonzero(np.diff(kept) > GAP) + 1)
    return np.array(
        [
            (first, min(first + kernels.TILE, part[-1] + 1))
            for part in parts
            for first in range(part[0], part[-1] + 1, kernels.TILE)
        ],
        dtype=np.int64,
    )


def _by_pair(
    pairs: ColumnPairs, places: NDArray[np.int64], fields: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], Modes]:
    """Sort the sources at some places by equation and pair.

    Returns:
        Index of the first source of each equation and pair, and their number at the end; the index
        of each source, ``(source,)``; and its factor, ``(source,)``.
    """
    found, factors = pairs.places(places)
    place = found[:, 0] * pairs.count + found[:, 1]
    order = np.argsort(place, kind="stable")
    first = np.searchsorted(place[order], np.arange(fields * pairs.count + 1))
    return first.astype(np.int64), found[order, 2], factors[order]


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
