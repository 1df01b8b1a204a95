"""Compiled loops of one stage over the columns of a group, ``(field, pair, mode)``.

The rate N is computed for some hundred modes at a time and used at once. A stage is completed in
place: it starts as the part that is known before its rate.
"""

from __future__ import annotations

import numba
import numpy as np

from dashred.physics.tangents.spectral_columns.arrays import Equations, Modes, PairSources, Real

# Modes that are computed together, so that their arrays stay in the cache.
TILE = 512

# Sums may be fused and reordered; NaN and infinity keep their meaning.
jit = numba.njit(
    nogil=True, cache=True, fastmath={"contract", "reassoc", "nsz"}, error_model="numpy"
)

# The group, the equations, and the sources of the pairs; and at one stage: rows of the sources, the
# derivative of the next stage with respect to L, and δG in modes.
StageInput = tuple[int, Equations, PairSources, Modes, Modes, Modes]


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
        for begin, stop in equations.tiles:
            for pair in range(modes.shape[1]):
                _send(equations, field, pair, begin, stop, modes, spectra)


@jit
def first_stage(
    own: StageInput,
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
        own: what is given at the stage u.
        step: coefficients of the step, ``(coefficient, field, mode)``.
        u: the columns at the start of the step.
        a: set to ``exp(hL/2) u + q N(u)``, with the sources that change L.
        b: set to ``exp(hL/2) u``.
        c: set to ``exp(hL/2) a - q N(u)``, where a is without these sources.
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
    own: StageInput,
    q: Modes,
    middle: Modes,
    before: Modes,
    stage: Modes,
    end: Modes,
    spectra: Modes,
) -> None:
    """Add ``q N`` to a stage, with the sources that change L; and ``middle N`` to the step's end.

    Args:
        own: what is given at the stage before.
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
def last_stage(
    own: StageInput, last: Modes, before: Modes, end: Modes, u: Modes, spectra: Modes
) -> None:
    """Set ``u = end + last N``, with the sources that change L; see :func:`middle_stage`."""
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
    own: StageInput, modes: Modes, field: int, pair: int, begin: int, stop: int, rates: Modes
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
def _add_shifts(own: StageInput, field: int, pair: int, begin: int, stop: int, out: Modes) -> None:
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
