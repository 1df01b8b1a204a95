"""Compiled loops over the columns of a sensitivity; each loop works on rows that fit in the cache.

Columns are ``(field, column, mode)``, complex64 or complex128: pairs of real columns
(:mod:`.column_pairs`). The axes of a mode are flattened.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

Real = NDArray[Any]
Modes = NDArray[Any]
Places = NDArray[np.int64]

# Sums may be fused and reordered; NaN and infinity keep their meaning.
jit = numba.njit(
    nogil=True, cache=True, fastmath={"contract", "reassoc", "nsz"}, error_model="numpy"
)


@jit
def apply_slopes(inputs: Real, slopes: Real, reads: Places, writes: Places, out: Real) -> None:
    """Set ``δG_m = Σ_i ∂G_m/∂v_i δv_i``, for pairs of columns.

    Args:
        inputs: δv of both columns in turn, ``(input, pair, 2 point)``.
        slopes: ∂G/∂v, ``(slope, point)``.
        reads: index of the input of each slope.
        writes: index of the channel of each slope, sorted.
        out: δG, ``(channel, pair, 2 point)``.
    """
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
def add_products(factors: Modes, terms: Modes, reads: Places, writes: Places, out: Modes) -> None:
    """Add ``factors[s] terms[reads[s]]`` to ``out[writes[s]]``, for each s and column."""
    for column in range(out.shape[1]):
        for s in range(len(reads)):
            factor, term, total = factors[s], terms[reads[s], column], out[writes[s], column]
            for k in range(len(total)):
                total[k] += factor[k] * term[k]


@jit
def gather_products(modes: Modes, factors: Modes, reads: Places, out: Modes) -> None:
    """Set ``out[s] = factors[s] modes[reads[s]]``, for each s and column."""
    for s in range(len(reads)):
        for column in range(out.shape[1]):
            factor, mode, result = factors[s], modes[reads[s], column], out[s, column]
            for k in range(len(result)):
                result[k] = factor[k] * mode[k]


@jit
def add_rows(rows: Modes, places: Places, factors: Modes, out: Modes) -> None:
    """Add ``factors[p] rows[r]`` to ``out[e, c]`` for each place p ``(e, c, r)``."""
    for p in range(len(places)):
        factor = factors[p]
        row, total = rows[places[p, 2]], out[places[p, 0], places[p, 1]]
        for k in range(len(total)):
            total[k] += factor * row[k]


@jit
def add_shifts(symbols: Modes, shift: Modes, places: Places, out: Modes) -> None:
    """Add ``symbols[p] shift[equation]`` to ``out[equation, column]`` for each place p."""
    for p in range(len(places)):
        equation = places[p, 0]
        factor, change, total = symbols[p], shift[equation], out[equation, places[p, 1]]
        for k in range(len(total)):
            total[k] += factor[k] * change[k]


@jit
def first_stage(
    u: Modes, n: Modes, step: Modes, linear: Modes, rest: Modes, end: Modes, a: Modes
) -> None:
    """Compute stage a and the contributions of u and N(u) to the later stages.

    Args:
        u: state at the start of the step.
        n: N(u).
        step: coefficients of the step, ``(coefficient, field, mode)``.
        linear: set to ``exp(hL/2) u``, for stage b.
        rest: set to ``exp(hL/2) a - q N(u)``, for stage c.
        end: set to ``exp(hL) u + first N(u)``, for the end of the step.
        a: set to the next stage.
    """
    for field in range(u.shape[0]):
        full, half, q, first = step[0, field], step[1, field], step[2, field], step[3, field]
        for column in range(u.shape[1]):
            at, rate = u[field, column], n[field, column]
            to_b, to_c, to_end = linear[field, column], rest[field, column], end[field, column]
            to_a = a[field, column]
            for k in range(len(at)):
                driven = q[k] * rate[k]
                damped = half[k] * at[k]
                to_b[k] = damped
                to_a[k] = damped + driven
                to_c[k] = half[k] * (damped + driven) - driven
                to_end[k] = full[k] * at[k] + first[k] * rate[k]


@jit
def middle_stage(base: Modes, n: Modes, q: Modes, middle: Modes, end: Modes, result: Modes) -> None:
    """Set ``result = base + q n`` and add ``middle n`` to the end of the step."""
    for field in range(base.shape[0]):
        factor, weight = q[field], middle[field]
        for column in range(base.shape[1]):
            known, rate = base[field, column], n[field, column]
            total, out = end[field, column], result[field, column]
            for k in range(len(out)):
                out[k] = known[k] + factor[k] * rate[k]
                total[k] += weight[k] * rate[k]


@jit
def last_stage(end: Modes, n: Modes, last: Modes, result: Modes) -> None:
    """Set ``result = end + last n``."""
    for field in range(end.shape[0]):
        weight = last[field]
        for column in range(end.shape[1]):
            total, rate, out = end[field, column], n[field, column], result[field, column]
            for k in range(len(out)):
                out[k] = total[k] + weight[k] * rate[k]
