"""Columns in groups of pairs, which are integrated independently."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dashred.core.work import count_transforms
from dashred.physics.solvers.compiled.step import STAGES
from dashred.physics.tangents.semilinear_rhs import Modes
from dashred.physics.tangents.spectral_columns.arrays import BlockArrays, PairSources, Work
from dashred.physics.tangents.spectral_columns.integrator import (
    SensitivityIntegrator,
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
        self.sources = PairSources(
            first_drive,
            rows,
            factors.astype(self.dtype),
            first_shift,
            (integrator.linear_terms[terms] * scales[:, None]).astype(self.dtype),
        )

    @classmethod
    def begin(
        cls,
        integrator: SensitivityIntegrator,
        points: Real,
        first: int,
        count: int,
        data: StageData,
        span: float,
    ) -> Groups:
        """Return columns at the first time.

        Args:
            integrator: of all columns.
            points: their values, ``(field, column, *grid)``.
            first: index of the first of them among all columns.
            count: number of pairs in a group.
            data: of the reference trajectory over the first steps.
            span: duration of these steps.
        """
        sources, chosen = integrator.sources, range(first, first + points.shape[1])
        shifts, drives = (select_columns(p, chosen) for p in (sources.shifts, sources.drives))
        axes = (0, *range(2, points.ndim))
        sizes = np.sqrt(np.square(points.astype(np.float64)).mean(axis=axes))
        driven = span * size_of_modes(data.rows[:, drives[:, 2]]).max(axis=0)
        np.maximum.at(sizes, drives[:, 1], driven)
        moved = integrator.linear_terms[shifts[:, 2]] * data.shifts[:, shifts[:, 0]]
        np.maximum.at(sizes, shifts[:, 1], size_of_modes(moved).max(axis=0))
        # Those of a group depend on no other group, because others may be integrated elsewhere.
        each = [power_of_two(sizes[i : i + 2 * count]) for i in range(0, len(sizes), 2 * count)]
        pairs = ColumnPairs(np.concatenate(each), integrator.shape)
        return cls(integrator, pairs, points, count, drives, shifts)

    def advance(self, part: range, block: BlockArrays, work: Work, result: Real) -> None:
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
        advance_groups(part.start, part.stop, own, columns, result)
        transforms = len(equations.multipliers) + len(equations.channels)
        made = STAGES * len(block.lengths) * transforms + int(block.ends.sum()) * self.fields
        count_transforms(2 * len(part) * self.pairs * made, math.prod(grid))

    def work(self) -> Work:
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
        return Work(stages, spectra, real[0], real[1], hats, real[2], *both)

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
