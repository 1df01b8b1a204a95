"""Compiled integration of the columns of a sensitivity, with their Fourier transforms.

The columns are pairs of real ones (:mod:`.column_pairs`), in groups whose arrays fit in the cache:
``(group, field, pair, mode)``, complex64 or complex128, where the axes of a mode are flattened. A
group is integrated over all steps of a block at once, in compiled code that releases the GIL.

The rate N is computed for some hundred modes at a time and used at once. A stage is completed in
place: it starts as the part that is known before its rate.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray
from rocket_fft import c2c

from dashred.physics.solvers.compiled.step import STAGES

Real = NDArray[Any]
Modes = NDArray[Any]
Places = NDArray[np.int64]

# Modes that are computed together. Their arrays fit in the first level of the cache.
TILE = 512

# Sums may be fused and reordered; NaN and infinity keep their meaning.
jit = numba.njit(
    nogil=True, cache=True, fastmath={"contract", "reassoc", "nsz"}, error_model="numpy"
)


class Equations(NamedTuple):
    """The linearised equations as arrays, the same for all columns.

    Attributes:
        tiles: first and last mode of each tile, ``(tile, 2)``; modes outside of them are zero.
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
    """The sources of all groups. Those of a group, equation and pair are at their flat index.

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


class Block(NamedTuple):
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


@jit
def advance_groups(
    first: int,
    last: int,
    given: tuple[Equations, PairSources, Block, Work],
    columns: tuple[Modes, Modes, Real],
    result: Real,
) -> None:
    """Integrate the groups from ``first`` to before ``last`` over a block of steps.

    Args:
        first: index of the first group.
        last: index after the last group.
        given: the equations, the sources, the steps, and arrays of this thread.
        columns: in modes, ``(group, field, pair, mode)``, advanced in place; the same memory as
            ``(group, field, pair, *grid)``; and the factor of each column, ``(column,)``.
        result: set to the columns at output times, ``(output, column, field, point)``.
    """
    equations, sources, block, work = given
    modes, modes_grid, scales = columns
    a, b, c, end = work.stages[0], work.stages[1], work.stages[2], work.stages[3]
    norm = 1.0 / modes.shape[3]
    for group in range(first, last):
        u, saved = modes[group], 0
        gather_inputs(equations, u, work.spectra)
        for i in range(len(block.lengths)):
            step = block.coefficients[block.lengths[i]]
            for stage in range(STAGES):
                at = STAGES * i + stage
                if len(equations.reads):
                    c2c(work.spectra_grid, work.inputs_grid, equations.axes, False, norm, 1)
                    apply_slopes(equations, work.inputs, block.slopes[at], work.channels)
                    c2c(work.channels_grid, work.hats_grid, equations.axes, True, 1.0, 1)
                own = group, equations, sources, block.rows[at], block.shifts[at], work.hats
                if stage == 0:
                    first_stage(own, step, u, a, b, c, end, work.spectra)
                elif stage == 1:
                    middle_stage(own, step[2], step[4], a, b, end, work.spectra)
                elif stage == 2:
                    middle_stage(own, step[6], step[4], b, c, end, work.spectra)
                else:
                    last_stage(own, step[5], c, end, u, work.spectra)
            if block.ends[i]:
                c2c(modes_grid[group], work.points_grid, equations.axes, False, norm, 1)
                _keep(group, work.points, scales, result[saved])
                saved += 1


@jit
def _keep(group: int, points: Real, scales: Real, result: Real) -> None:
    """Write the columns of a group to ``(column, field, point)``, times their scales."""
    pairs = points.shape[1]
    for pair in range(pairs):
        for part in range(2):
            column = 2 * (group * pairs + pair) + part
            if column < len(scales):
                for field in range(len(points)):
                    value, out = points[field, pair], result[column, field]
                    for i in range(len(out)):
                        out[i] = scales[column] * value[2 * i + part]


Own = tuple[int, Equations, PairSources, Modes, Modes, Modes]


@jit
def apply_slopes(equations: Equations, inputs: Real, slopes: Real, out: Real) -> None:
    """Set ``δG_m = Σ_i ∂G_m/∂v_i δv_i``, for pairs of columns.

    Args:
        equations: of the columns.
        inputs: δv of both columns in turn, ``(input, pair, 2 point)``.
        slopes: ∂G/∂v, ``(slope, point)``.
        out: δG, ``(channel, pair, 2 point)``.
    """
    reads, writes = equations.reads, equations.writes
    for pair in range(out.shape[1]):
        for s in range(len(reads)):
            v, g, slope = inputs[reads[s], pair], out[writes[s], pair], slopes[s]
            if s == 0 or writes[s] != writes[s - 1]:
                for i in range(len(slope)):
                    g[2 * i] = slope[i] * v[2 * i]
                    g[2 * i + 1] = slope[i] * v[2 * i + 1]
            else:
                for i in range(len(slope)):
                    g[2 * i] += slope[i] * v[2 * i]
                    g[2 * i + 1] += slope[i] * v[2 * i + 1]


@jit
def gather_inputs(equations: Equations, modes: Modes, spectra: Modes) -> None:
    """Set the inputs of the slopes in modes, ``spectra[s] = V_s modes[field of s]``."""
    for field in range(modes.shape[0]):
        for first, last in equations.tiles:
            for pair in range(modes.shape[1]):
                _send(equations, field, pair, first, last, modes, spectra)


@jit
def first_stage(
    own: Own,
    step: Modes,
    u: Modes,
    a: Modes,
    b: Modes,
    c: Modes,
    end: Modes,
    spectra: Modes,
) -> None:
    """Compute stage a, and begin the later stages.

    Args:
        own: the group, the equations and the sources of the pairs; and at the stage u, rows of
            the sources, derivative of stage a with respect to L, and δG in modes.
        step: coefficients of the step, ``(coefficient, field, mode)``.
        u: the columns at the start of the step.
        a: set to ``exp(hL/2) u + q N(u)``.
        b: set to ``exp(hL/2) u``.
        c: set to ``exp(hL/2) a - q N(u)``.
        end: set to ``exp(hL) u + first N(u)``.
        spectra: set to the inputs of the slopes at stage a.
    """
    equations = own[1]
    rates = np.empty(TILE, u.dtype)
    for field in range(u.shape[0]):
        for begin, stop in equations.tiles:
            full, half = step[0, field, begin:stop], step[1, field, begin:stop]
            q, first = step[2, field, begin:stop], step[3, field, begin:stop]
            for pair in range(u.shape[1]):
                _set_rates(own, u, field, pair, begin, stop, rates)
                at, to_a = u[field, pair, begin:stop], a[field, pair, begin:stop]
                to_b, to_c = b[field, pair, begin:stop], c[field, pair, begin:stop]
                to_end = end[field, pair, begin:stop]
                for k in range(len(at)):
                    driven = q[k] * rates[k]
                    damped = half[k] * at[k]
                    to_a[k] = damped + driven
                    to_b[k] = damped
                    to_c[k] = half[k] * (damped + driven) - driven
                    to_end[k] = full[k] * at[k] + first[k] * rates[k]
                _add_shifts(own, field, pair, begin, stop, a)
                _send(equations, field, pair, begin, stop, a, spectra)


@jit
def middle_stage(
    own: Own,
    q: Modes,
    middle: Modes,
    before: Modes,
    stage: Modes,
    end: Modes,
    spectra: Modes,
) -> None:
    """Add ``q N`` to a stage, and ``middle N`` to the end of the step.

    Args:
        own: as in :func:`first_stage`, at the stage before.
        q: weight of the rate in this stage, ``(field, mode)``.
        middle: its weight at the end of the step.
        before: the stage at which the rate is.
        stage: this stage.
        end: the end of the step.
        spectra: set to the inputs of the slopes at this stage.
    """
    equations = own[1]
    rates = np.empty(TILE, stage.dtype)
    for field in range(stage.shape[0]):
        for begin, stop in equations.tiles:
            weight, factor = middle[field, begin:stop], q[field, begin:stop]
            for pair in range(stage.shape[1]):
                _set_rates(own, before, field, pair, begin, stop, rates)
                out, total = stage[field, pair, begin:stop], end[field, pair, begin:stop]
                for k in range(len(out)):
                    out[k] += factor[k] * rates[k]
                    total[k] += weight[k] * rates[k]
                _add_shifts(own, field, pair, begin, stop, stage)
                _send(equations, field, pair, begin, stop, stage, spectra)


@jit
def last_stage(own: Own, last: Modes, before: Modes, end: Modes, u: Modes, spectra: Modes) -> None:
    """Set ``u = end + last N``; the arguments are those of :func:`middle_stage`."""
    equations = own[1]
    rates = np.empty(TILE, end.dtype)
    for field in range(end.shape[0]):
        for begin, stop in equations.tiles:
            weight = last[field, begin:stop]
            for pair in range(end.shape[1]):
                _set_rates(own, before, field, pair, begin, stop, rates)
                total, out = end[field, pair, begin:stop], u[field, pair, begin:stop]
                for k in range(len(total)):
                    out[k] = total[k] + weight[k] * rates[k]
                _add_shifts(own, field, pair, begin, stop, u)
                _send(equations, field, pair, begin, stop, u, spectra)


@jit
def _set_rates(
    own: Own, modes: Modes, field: int, pair: int, begin: int, stop: int, rates: Modes
) -> None:
    """Set ``N'δu + θ`` of one equation, pair and tile."""
    group, equations, sources, rows, _, hats = own
    for k in range(stop - begin):
        rates[k] = 0
    for s in range(len(equations.channels)):
        if equations.channels[s] == field:
            symbol, hat = equations.channel_symbols[s, begin:stop], hats[s, pair, begin:stop]
            for k in range(stop - begin):
                rates[k] += symbol[k] * hat[k]
    for s in range(len(equations.coupled)):
        if equations.coupled[s, 0] == field:
            coupling = equations.couplings[s, begin:stop]
            other = modes[equations.coupled[s, 1], pair, begin:stop]
            for k in range(stop - begin):
                rates[k] += coupling[k] * other[k]
    place = (group * modes.shape[0] + field) * modes.shape[1] + pair
    for s in range(sources.first_drive[place], sources.first_drive[place + 1]):
        factor, row = sources.factors[s], rows[sources.rows[s], begin:stop]
        for k in range(stop - begin):
            rates[k] += factor * row[k]


@jit
def _add_shifts(own: Own, field: int, pair: int, begin: int, stop: int, out: Modes) -> None:
    """Add ``symbols[s] shift`` of one equation, pair and tile to a stage."""
    group, _, sources, _, shift, _ = own
    place = (group * out.shape[0] + field) * out.shape[1] + pair
    for s in range(sources.first_shift[place], sources.first_shift[place + 1]):
        symbol, change = sources.symbols[s, begin:stop], shift[field, begin:stop]
        total = out[field, pair, begin:stop]
        for k in range(stop - begin):
            total[k] += symbol[k] * change[k]


@jit
def _send(
    equations: Equations,
    field: int,
    pair: int,
    begin: int,
    stop: int,
    modes: Modes,
    spectra: Modes,
) -> None:
    """Set the inputs that read one field, for one pair and tile."""
    mode = modes[field, pair, begin:stop]
    for s in range(len(equations.inputs)):
        if equations.inputs[s] == field:
            multiplier, result = equations.multipliers[s, begin:stop], spectra[s, pair, begin:stop]
            for k in range(stop - begin):
                result[k] = multiplier[k] * mode[k]
