"""Integrate the columns of a sensitivity along a reference trajectory."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dashred.core.work import count_transforms
from dashred.physics.expressions.algebra import Expr
from dashred.physics.grids.full_spectrum import full_spectrum
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


class StageData(NamedTuple):
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
        slopes: the expressions ∂G/∂v, in the order of ``StageData.slopes``.
        equations: the linearised equations.
        linear_terms: symbols of the sources that change L, ``(term, mode)``.
        mask: of the 2/3 rule, ``(mode,)``.

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
        channels, writes = renumber([channel for channel, _, _ in result])
        inputs, reads = renumber([place for _, place, _ in result])
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
            reads=reads,
            writes=writes,
            axes=np.arange(2, 2 + len(self.shape)),
        )
        self.linear_terms = self.full(sources.symbols)
        self._coefficients = cache(self._coefficients_of)

    def begin(self, points: Real, first: int, count: int, data: StageData, span: float) -> Groups:
        """Return columns at the first time.

        Args:
            points: their values, ``(field, column, *grid)``.
            first: index of the first of them among all columns.
            count: number of pairs in a group.
            data: of the reference trajectory over the first steps.
            span: duration of these steps.
        """
        sources, chosen = self.sources, range(first, first + points.shape[1])
        shifts, drives = (select_columns(p, chosen) for p in (sources.shifts, sources.drives))
        axes = (0, *range(2, points.ndim))
        sizes = np.sqrt(np.square(points.astype(np.float64)).mean(axis=axes))
        driven = span * size_of_modes(data.rows[:, drives[:, 2]]).max(axis=0)
        np.maximum.at(sizes, drives[:, 1], driven)
        moved = self.linear_terms[shifts[:, 2]] * data.shifts[:, shifts[:, 0]]
        np.maximum.at(sizes, shifts[:, 1], size_of_modes(moved).max(axis=0))
        # Those of a group depend on no other group, because others may be integrated elsewhere.
        each = [power_of_two(sizes[i : i + 2 * count]) for i in range(0, len(sizes), 2 * count)]
        pairs = ColumnPairs(np.concatenate(each), self.shape)
        return Groups(self, pairs, points, count, drives, shifts)

    def block(self, steps: Sequence[Step], data: StageData) -> kernels.Block:
        """Return what the columns need for some steps."""
        lengths = tuple(dict.fromkeys(step.h for step in steps))
        return kernels.Block(
            np.array([lengths.index(step.h) for step in steps], dtype=np.int64),
            np.array([step.ends for step in steps]),
            self._coefficients(lengths),
            *data,
        )

    def full(self, modes: Modes) -> Modes:
        """Complete modes ``(…, *modes)`` and flatten their axes, in the columns' precision."""
        full = full_spectrum(modes, self.shape, self.dtype)
        return full.reshape(*full.shape[: full.ndim - len(self.shape)], math.prod(self.shape))

    def _symbols(self, symbols: Modes) -> Modes:
        """Complete symbols ``(item, …, *modes)`` and flatten them to ``(item, mode)``."""
        return self.full(symbols.reshape(len(symbols), *self.tendency.mask.shape))

    def _coefficients_of(self, lengths: tuple[float, ...]) -> Modes:
        known = [self.tendency.coefficients(h) for h in lengths]
        return np.array([[self._symbols(c) for c in (*each, 2 * each[2])] for each in known])


class Groups:
    """Columns in groups of pairs, of which any can be integrated at once.

    Args:
        integrator: of all columns.
        pairs: of these columns.
        points: their values at the first time, ``(field, column, *grid)``.
        count: number of pairs in a group; the last one is completed by columns of zeros.
        drives: places of the rows of sources among them, ``(source, 3)``.
        shifts: places of the linear terms among them, ``(source, 3)``.
    """

    def __init__(
        self,
        integrator: SensitivityIntegrator,
        pairs: ColumnPairs,
        points: Real,
        count: int,
        drives: NDArray[np.int64],
        shifts: NDArray[np.int64],
    ) -> None:
        self.integrator, self.dtype = integrator, integrator.dtype
        self.fields, self.pairs, self.groups = len(points), count, -(-pairs.count // count)
        self.scales = pairs.scales.astype(points.dtype)
        size = math.prod(integrator.shape)
        modes = pairs.to_modes(points).reshape(self.fields, pairs.count, size) * integrator.mask
        whole = np.zeros((self.fields, self.groups * count, size), dtype=self.dtype)
        whole[:, : pairs.count] = modes
        parts = whole.reshape(self.fields, self.groups, count, size).swapaxes(0, 1)
        self.modes = np.ascontiguousarray(parts)
        first_drive, rows, factors = self._by_place(pairs, drives)
        first_shift, terms, scales = self._by_place(pairs, shifts)
        self.sources = kernels.PairSources(
            first_drive,
            rows,
            factors.astype(self.dtype),
            first_shift,
            (integrator.linear_terms[terms] * scales[:, None]).astype(self.dtype),
        )

    def advance(self, part: range, block: kernels.Block, work: kernels.Work, result: Real) -> None:
        """Integrate some groups over a block of steps.

        Args:
            part: the groups.
            block: the steps.
            work: arrays that no other thread uses.
            result: set to their columns at output times, ``(output, column, field, point)``.
        """
        equations, grid = self.integrator.equations, self.integrator.shape
        own = equations, self.sources, block, work
        modes_grid = self.modes.reshape(*self.modes.shape[:3], *grid)
        columns = self.modes, modes_grid, self.scales
        kernels.advance_groups(part.start, part.stop, own, columns, result)
        transforms = len(equations.multipliers) + len(equations.channels)
        made = STAGES * len(block.lengths) * transforms + int(block.ends.sum()) * self.fields
        count_transforms(2 * len(part) * self.pairs * made, math.prod(grid))

    def work(self) -> kernels.Work:
        """Return arrays for one thread."""
        equations, grid = self.integrator.equations, self.integrator.shape
        items = len(equations.multipliers), len(equations.channels), self.fields
        inputs, channels, fields = ((count, self.pairs, *grid) for count in items)
        # Modes that the 2/3 rule removes are never written, and stay zero.
        stages = np.zeros((STAGES, self.fields, *self.modes.shape[2:]), dtype=self.dtype)
        both = [np.zeros(s, dtype=self.dtype) for s in (inputs, inputs, channels, channels, fields)]
        flat = [each.reshape(*each.shape[:2], math.prod(grid)) for each in both]
        spectra, values, changes, hats, points = flat
        real = [_both_parts(each) for each in (values, changes, points)]
        return kernels.Work(stages, spectra, real[0], real[1], hats, real[2], *both)

    def _by_place(
        self, pairs: ColumnPairs, places: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], Modes]:
        """Sort sources by group, equation and pair.

        Returns:
            Index of the first source of each place, and their number at the end; the index of each
            source, ``(source,)``; and its factor, ``(source,)``.
        """
        found, factors = pairs.places(places)
        group, pair = np.divmod(found[:, 1], self.pairs)
        place = (group * self.fields + found[:, 0]) * self.pairs + pair
        order = np.argsort(place, kind="stable")
        bounds = np.arange(self.groups * self.fields * self.pairs + 1)
        first = np.searchsorted(place[order], bounds).astype(np.int64)
        return first, found[order, 2], factors[order]


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
