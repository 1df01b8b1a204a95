"""The linearised equations of the columns of a sensitivity, as arrays of compiled code."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dashred.physics.expressions.algebra import Expr
from dashred.physics.grids.full_spectrum import full_spectrum
from dashred.physics.solvers.schedule import Step
from dashred.physics.tangents.semilinear_rhs import Modes, SemilinearTendency
from dashred.physics.tangents.sources import Sources
from dashred.physics.tangents.spectral_columns.arrays import BlockArrays, Equations
from dashred.physics.tangents.spectral_columns.stages import TILE

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


class ColumnEquations:
    """The equations ``δu' = Lδu + N'(u)δu + θ`` and their steps with ETDRK4.

    Attributes:
        slopes: the expressions ∂G/∂v, in the order of ``StageData.slopes``.
        arrays: the equations of all columns.
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
        self.arrays = Equations(
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

    def block(self, steps: Sequence[Step], data: StageData) -> BlockArrays:
        """Return what the columns need for some steps."""
        lengths = tuple(dict.fromkeys(step.h for step in steps))
        return BlockArrays(
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
        """Return the coefficients for some lengths, ``(length, coefficient, field, mode)``."""
        known = [self.tendency.coefficients(h) for h in lengths]
        return np.array([[self._symbols(c) for c in (*each, 2 * each[2])] for each in known])


def _tiles(mask: Real) -> NDArray[np.int64]:
    """Return the first mode of each tile and the one after its last, ``(tile, 2)``.

    The tiles cover all modes of a mask ``(mode,)``, and gaps of fewer than :data:`GAP`.
    """
    kept = np.flatnonzero(mask)
    parts = np.split(kept, np.flatnonzero(np.diff(kept) > GAP) + 1)
    return np.array(
        [
            (first, min(first + TILE, part[-1] + 1))
            for part in parts
            for first in range(part[0], part[-1] + 1, TILE)
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
