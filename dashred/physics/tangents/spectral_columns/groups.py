"""Columns in groups of pairs, which are integrated independently."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dashred.core.work import count_transforms
from dashred.physics.grids.transforms import to_full_modes
from dashred.physics.solvers.compiled.step import STAGES
from dashred.physics.tangents.semilinear_rhs import Modes
from dashred.physics.tangents.spectral_columns.arrays import BlockArrays, PairSources, Work
from dashred.physics.tangents.spectral_columns.equations import (
    ColumnEquations,
    StageData,
    select_columns,
)
from dashred.physics.tangents.spectral_columns.kernels import advance_groups
from dashred.physics.tangents.spectral_columns.pairs import (
    ColumnPairs,
    power_of_two,
    size_of_modes,
)

Real = NDArray[Any]


class Groups:
    """Columns in groups of pairs, which are independent of each other.

    Attributes:
        size: number of pairs in a group.
        count: number of groups.
        modes: the columns, ``(group, field, pair, mode)``.
        scales: factor of each column, ``(column,)``.
        sources: of the pairs.

    Args:
        equations: of all columns.
        columns: these columns in pairs.
        points: their values at the first time, ``(field, column, *grid)``.
        size: number of pairs in a group; the last one is completed by pairs of zeros.
        drives: places of the rows of sources among them, ``(source, 3)``.
        shifts: places of the linear terms among them, ``(source, 3)``.
    """

    def __init__(
        self,
        equations: ColumnEquations,
        columns: ColumnPairs,
        points: Real,
        size: int,
        drives: NDArray[np.int64],
        shifts: NDArray[np.int64],
    ) -> None:
        self.equations, self.dtype = equations, equations.dtype
        self.fields, self.size, self.count = len(points), size, -(-columns.count // size)
        self.scales = columns.scales.astype(points.dtype)
        paired = columns.paired(points, self.count * size)
        by_group = np.split(paired, self.count, axis=1)
        # One transform for each group: its bits may depend on how many columns it transforms.
        modes = [to_full_modes(np.ascontiguousarray(g), len(equations.shape)) for g in by_group]
        flat = self.count, self.fields, size, math.prod(equations.shape)
        self.modes = np.array(modes).reshape(flat) * equations.mask
        first_drive, rows, factors = self._by_place(columns, drives)
        first_shift, terms, scales = self._by_place(columns, shifts)
        self.sources = PairSources(
            first_drive,
            rows,
            factors.astype(self.dtype),
            first_shift,
            (equations.linear_terms[terms] * scales[:, None]).astype(self.dtype),
        )

    @classmethod
    def begin(
        cls,
        equations: ColumnEquations,
        points: Real,
        first: int,
        size: int,
        data: StageData,
        span: float,
    ) -> Groups:
        """Return columns at the first time.

        Args:
            equations: of all columns.
            points: their values, ``(field, column, *grid)``.
            first: index of the first of them among all columns.
            size: number of pairs in a group.
            data: of the reference trajectory over the first steps.
            span: duration of these steps.
        """
        sources, chosen = equations.sources, range(first, first + points.shape[1])
        shifts, drives = (select_columns(p, chosen) for p in (sources.shifts, sources.drives))
        axes = (0, *range(2, points.ndim))
        sizes = np.sqrt(np.square(points.astype(np.float64)).mean(axis=axes))
        driven = span * size_of_modes(data.rows[:, drives[:, 2]]).max(axis=0)
        np.maximum.at(sizes, drives[:, 1], driven)
        moved = equations.linear_terms[shifts[:, 2]] * data.shifts[:, shifts[:, 0]]
        np.maximum.at(sizes, shifts[:, 1], size_of_modes(moved).max(axis=0))
        # Those of a group depend on no other group, because others may be integrated elsewhere.
        each = [power_of_two(sizes[i : i + 2 * size]) for i in range(0, len(sizes), 2 * size)]
        columns = ColumnPairs(np.concatenate(each), equations.shape)
        return cls(equations, columns, points, size, drives, shifts)

    def advance(self, part: range, block: BlockArrays, work: Work, result: Real) -> None:
        """Integrate some groups over a block of steps.

        Args:
            part: the groups.
            block: the steps.
            work: arrays that no other thread uses.
            result: set to their columns at output times, ``(output, column, field, point)``.
        """
        arrays, grid = self.equations.arrays, self.equations.shape
        own = arrays, self.sources, block, work
        modes_grid = self.modes.reshape(*self.modes.shape[:3], *grid)
        columns = self.modes, modes_grid, self.scales
        advance_groups(part.start, part.stop, own, columns, result)
        transforms = len(arrays.multipliers) + len(arrays.channels)
        made = STAGES * len(block.lengths) * transforms + int(block.ends.sum()) * self.fields
        count_transforms(2 * len(part) * self.size * made, math.prod(grid))

    def work(self) -> Work:
        """Return arrays for one thread."""
        arrays, grid = self.equations.arrays, self.equations.shape
        items = len(arrays.multipliers), len(arrays.channels), self.fields
        inputs, channels, fields = ((count, self.size, *grid) for count in items)
        # Modes that the 2/3 rule removes are never written, and stay zero.
        stages = np.zeros((STAGES, self.fields, *self.modes.shape[2:]), dtype=self.dtype)
        both = [np.zeros(s, dtype=self.dtype) for s in (inputs, inputs, channels, channels, fields)]
        flat = [each.reshape(*each.shape[:2], math.prod(grid)) for each in both]
        spectra, values, changes, hats, points = flat
        real = [_both_parts(each) for each in (values, changes, points)]
        return Work(stages, spectra, real[0], real[1], hats, real[2], *both)

    def _by_place(
        self, columns: ColumnPairs, places: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], Modes]:
        """Sort sources by group, equation and pair.

        Returns:
            Index of the first source of each place, and their number at the end; the index of each
            source, ``(source,)``; and its factor, ``(source,)``.
        """
        found, factors = columns.places(places)
        group, pair = np.divmod(found[:, 1], self.size)
        place = (group * self.fields + found[:, 0]) * self.size + pair
        order = np.argsort(place, kind="stable")
        bounds = np.arange(self.count * self.fields * self.size + 1)
        first = np.searchsorted(place[order], bounds).astype(np.int64)
        return first, found[order, 2], factors[order]


def _both_parts(values: Modes) -> Real:
    """Return real and imaginary parts in turn, ``(…, 2 point)``; the same memory."""
    return values.view(values.real.dtype)
