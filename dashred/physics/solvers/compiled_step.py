"""Steps of ETDRK4 in machine code: one trajectory after another, transforms and all.

A few hundred points are so little that calling array operations costs more than they do; here
nothing is called between two output times. Trajectories are independent, so that several
threads may share a batch: the code holds no lock.
"""

# ruff: noqa: RUF005 (unpacking into a tuple is not compiled)

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
import scipy.fft
from numpy.typing import NDArray

from dashred.physics.backends.numba_backend import Array, Kernel

Modes = NDArray[np.complex128]
Indices = NDArray[np.int64]


class Plan(NamedTuple):
    """When to step: of every step its time, its length and whether an output lies at its ends.

    Attributes:
        t: begin of each step, ``(step,)``.
        h: length of each step, as an index into the coefficients, ``(step,)``.
        lengths: those lengths, ``(length,)``.
        begins, ends: whether an output time lies at its begin, at its end, ``(step,)``.
    """

    t: Array
    h: Indices
    lengths: Array
    begins: NDArray[np.bool_]
    ends: NDArray[np.bool_]


class Parts(NamedTuple):
    """``û' = Lû + Σ D[G(inputs)] + Σ S û`` of a batch, as arrays.

    Attributes:
        field: field that each derived input is of, ``(derived,)``.
        symbol: operator that makes it, ``(derived, mode)``.
        active: which trajectories read it, ``(row, derived)``.
        filled: which trajectories write each channel, ``(row, channel)``.
        place: field that each channel's tendency belongs to, ``(channel,)``.
        outside: operator D of each channel, ``(channel, mode)``.
        to, source: fields of each linear coupling S between fields, ``(coupling,)``.
        coupling: its symbol, ``(coupling, mode)``.
        strength: its coefficient, ``(row, coupling)``.
        mask: 1 for modes that are kept, ``(mode,)``.
        coordinates: of the points, ``(coordinate, point)``.
        weights: of the terms, ``(row, column)``.
        knots: where the drive's straight lines meet, ``(knot,)``; none without a drive.
        drive: a forcing of every row, ``(row, knot, field, mode)``.
    """

    field: Indices
    symbol: Modes
    active: NDArray[np.bool_]
    filled: NDArray[np.bool_]
    place: Indices
    outside: Modes
    to: Indices
    source: Indices
    coupling: Modes
    strength: Array
    mask: Array
    coordinates: Array
    weights: Array
    knots: Array
    sampled_forcing: Modes


@numba.njit(nogil=True, cache=True, error_model="numpy")
def between(knots: Array, t: float) -> tuple[int, float]:
    """Return the knot before a time, and the share of the way from it to the next, 0 to 1."""
    k = min(max(int(np.searchsorted(knots, t)) - 1, 0), len(knots) - 2)
    share = (t - knots[k]) / (knots[k + 1] - knots[k])
    return k, min(max(share, 0.0), 1.0)


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _rate(
    kernel: Kernel,
    modes: Modes,
    t: float,
    row: int,
    parts: Parts,
    shape: tuple[int, ...],
    axes: tuple[int, ...],
    spectra: Modes,
    inputs: Array,
    channels: Array,
    out: Modes,
) -> None:
    """Write N of one trajectory's modes ``(field, mode)`` into ``out``."""
    fields, count = modes.shape
    spectra[:fields] = modes
    used = fields
    for d in range(len(parts.field)):
        if parts.active[row, d]:
            spectra[used] = parts.symbol[d] * modes[parts.field[d]]
            used += 1
    halved = shape[:-1] + (shape[-1] // 2 + 1,)
    points = scipy.fft.irfftn(spectra[:used].reshape((used,) + halved), shape, axes)
    flat = points.reshape((used, inputs.shape[2]))
    inputs[:fields, 0] = flat[:fields]
    used = fields
    for d in range(len(parts.field)):
        if parts.active[row, d]:
            inputs[fields + d, 0] = flat[used]
            used += 1
    kernel(inputs, parts.coordinates, t, parts.weights[row : row + 1], channels)
    chosen = np.nonzero(parts.filled[row])[0]
    out[:] = 0.0
    if len(chosen):
        grown = channels[chosen].reshape((len(chosen),) + shape)
        hats = scipy.fft.rfftn(grown, shape, axes).reshape((len(chosen), count))
        for k in range(len(chosen)):
            out[parts.place[chosen[k]]] += parts.outside[chosen[k]] * hats[k]
    for k in range(len(parts.to)):
        if parts.strength[row, k] != 0.0:
            moved = parts.coupling[k] * modes[parts.source[k]]
            out[parts.to[k]] += parts.strength[row, k] * moved
    if len(parts.knots):
        k, share = between(parts.knots, t)
        out += (1 - share) * parts.sampled_forcing[row, k] + share * parts.sampled_forcing[
            row, k + 1
        ]
    out *= parts.mask


@numba.njit(nogil=True, cache=True, error_model="numpy")
def march_row(
    kernel: Kernel,
    row: int,
    parts: Parts,
    plan: Plan,
    factors: Modes,
    shape: tuple[int, ...],
    axes: tuple[int, ...],
    counts: tuple[int, int],
    states: Array,
) -> None:
    """Fill one of the trajectories ``(row, time, field, point)`` from its first state on.

    Args:
        kernel: everything pointwise.
        row: which.
        parts: the tendency.
        plan: the steps.
        factors: of ETDRK4: full, half, q, first, middle, last,
            ``(length, 6, row or 1, field, mode)``.
        shape: of the grid.
        axes: of the grid in an array with one axis before it.
        counts: inputs and channels of the kernel.
        states: all trajectories; NaN in all but the first of each, and from a blow-up on.
    """
    fields, points = states.shape[2:]
    count = factors.shape[-1]
    modes = np.empty((fields, count), np.complex128)
    n_u, n_a = np.empty_like(modes), np.empty_like(modes)
    n_b, n_c = np.empty_like(modes), np.empty_like(modes)
    spectra = np.empty((counts[0], count), np.complex128)
    inputs = np.zeros((counts[0], 1, points))
    channels = np.empty((counts[1], 1, points))
    halved = shape[:-1] + (shape[-1] // 2 + 1,)
    saved = 0
    for i in range(len(plan.t)):
        if plan.begins[i]:
            grown = states[row, saved].copy().reshape((fields,) + shape)
            modes[:] = scipy.fft.rfftn(grown, shape, axes).reshape((fields, count))
            modes *= parts.mask
        t, h, mine = plan.t[i], plan.lengths[plan.h[i]], factors[plan.h[i]]
        own = row if mine.shape[1] > 1 else 0
        full, half, q = mine[0, own], mine[1, own], mine[2, own]
        first, middle, last = mine[3, own], mine[4, own], mine[5, own]
        rest = row, parts, shape, axes, spectra, inputs, channels
        _rate(kernel, modes, t, *rest, n_u)
        linear = half * modes
        a = linear + q * n_u
        _rate(kernel, a, t + h / 2, *rest, n_a)
        _rate(kernel, linear + q * n_a, t + h / 2, *rest, n_b)
        _rate(kernel, half * a + q * (2 * n_b - n_u), t + h, *rest, n_c)
        modes[:] = full * modes + first * n_u + middle * (n_a + n_b) + last * n_c
        if plan.ends[i]:
            saved += 1
            grown = scipy.fft.irfftn(modes.reshape((fields,) + halved), shape, axes)
            states[row, saved] = grown.reshape((fields, points))
            if not np.isfinite(states[row, saved]).all():
                return
