"""The arrays of compiled code for columns.

Columns are pairs of real ones (:mod:`.pairs`), complex64 or complex128, and the axes of a mode are
flattened.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Real = NDArray[Any]
Modes = NDArray[Any]
Places = NDArray[np.int64]


class Equations(NamedTuple):
    """The linearised equations as arrays, the same for all columns.

    Attributes:
        tiles: first mode of each tile and the one after its last, ``(tile, 2)``; other modes are
            zero.
        channels: equation of each channel, ``(channel,)``.
        channel_symbols: D, ``(channel, mode)``.
        coupled: equation and field of each coupling, ``(coupling, 2)``.
        couplings: C, ``(coupling, mode)``.
        inputs: field of each input of the slopes, ``(input,)``.
        multipliers: V, ``(input, mode)``.
        reads: index of the input of each slope, ``(slope,)``.
        writes: index of the channel of each slope, sorted.
        axes: of the grid, in arrays ``(item, pair, *grid)``.
    """

    tiles: Places
    channels: Places
    channel_symbols: Modes
    coupled: Places
    couplings: Modes
    inputs: Places
    multipliers: Modes
    reads: Places
    writes: Places
    axes: Places


class PairSources(NamedTuple):
    """The sources of all groups.

    Those of a pair of a group are at ``(group * fields + equation) * pairs + pair``.

    Attributes:
        first_drive: index of the first drive of each place, and their number at the end.
        rows: row of the stages' sources that each drive reads, ``(drive,)``.
        factors: what the row is multiplied by, ``(drive,)``.
        first_shift: the same as ``first_drive`` for sources that change L.
        symbols: of these sources, with their factors, ``(shift, mode)``.
    """

    first_drive: Places
    rows: Places
    factors: Modes
    first_shift: Places
    symbols: Modes


class BlockArrays(NamedTuple):
    """Some time steps and what all columns share there.

    Attributes:
        lengths: index of each step's length among the coefficients, ``(step,)``.
        ends: whether a step ends at an output time, ``(step,)``.
        coefficients: of ETDRK4 for each length, and 2q, ``(length, coefficient, field, mode)``.
        slopes: ∂G/∂v, ``(stage, slope, point)``.
        rows: source terms of N, ``(stage, row, mode)``.
        shifts: derivatives of the next stage with respect to L, ``(stage, field, mode)``.
    """

    lengths: Places
    ends: NDArray[np.bool_]
    coefficients: Modes
    slopes: Real
    rows: Modes
    shifts: Modes


class Work(NamedTuple):
    """Arrays for one group at a time; names ending in ``grid`` are the same memory.

    Attributes:
        stages: a, b, c and the end of the step, ``(4, field, pair, mode)``.
        spectra: inputs of the slopes in modes, ``(input, pair, mode)``.
        inputs: the same at the points, both columns in turn, ``(input, pair, 2 point)``.
        channels: δG, ``(channel, pair, 2 point)``.
        hats: δG in modes, ``(channel, pair, mode)``.
        points: columns at an output time, ``(field, pair, 2 point)``.
        spectra_grid, inputs_grid, channels_grid, hats_grid, points_grid: ``(item, pair, *grid)``.
    """

    stages: Modes
    spectra: Modes
    inputs: Real
    channels: Real
    hats: Modes
    points: Real
    spectra_grid: Modes
    inputs_grid: Modes
    channels_grid: Modes
    hats_grid: Modes
    points_grid: Modes
