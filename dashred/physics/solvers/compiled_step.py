"""ETDRK4 time steps of one trajectory in machine code, including the Fourier transforms.

On grids of a few hundred points, the overhead of calling array operations exceeds their cost.
Compiled code avoids these calls. The code releases the GIL, so several threads can integrate
different rows of one batch.
"""

# ruff: noqa: RUF005 (Numba does not compile unpacking into a tuple)

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
import scipy.fft
from numpy.typing import NDArray

from dashred.physics.backends.numba_backend import Array, Kernel

Modes = NDArray[np.complex128]
Indices = NDArray[np.int64]


class StepArrays(NamedTuple):
    """Time steps as arrays.

    Attributes:
        t: start time of each step, ``(step,)``.
        h: index of each step's length in ``lengths``, ``(step,)``.
        lengths: the different step lengths, ``(length,)``.
        begins, ends: whether the step starts or ends at an output time, ``(step,)``.
    """

    t: Array
    h: Indices
    lengths: Array
    begins: NDArray[np.bool_]
    ends: NDArray[np.bool_]


class TendencyArrays(NamedTuple):
    """The nonlinear part ``N = Σ D[G(inputs)] + Σ S û`` of a batch, as arrays.

    Attributes:
        input_field: field of each derived input, ``(derived,)``.
        input_symbol: Fourier symbol of its operator, ``(derived, mode)``.
        input_active: whether a row reads it, ``(row, derived)``.
        channel_active: whether a row writes each channel, ``(row, channel)``.
        channel_field: field whose tendency the channel belongs to, ``(channel,)``.
        channel_symbol: Fourier symbol of its operator D, ``(channel, mode)``.
        coupling_target, coupling_source: fields of each linear coupling S, ``(coupling,)``.
        coupling_symbol: Fourier symbol of S, ``(coupling, mode)``.
        coupling_strength: its coefficient, ``(row, coupling)``.
        mask: 1 for modes that are kept, 0 for modes removed by dealiasing, ``(mode,)``.
        coordinates: of the grid points, ``(coordinate, point)``.
        weights: coefficients of the terms, ``(row, column)``.
        knots: interpolation times of the free forcing, ``(knot,)``; empty without one.
        sampled_forcing: the free forcing in modes, ``(row, knot, field, mode)``.
    """

    input_field: Indices
    input_symbol: Modes
    input_active: NDArray[np.bool_]
    channel_active: NDArray[np.bool_]
    channel_field: Indices
    channel_symbol: Modes
    coupling_target: Indices
    coupling_source: Indices
    coupling_symbol: Modes
    coupling_strength: Array
    mask: Array
    coordinates: Array
    weights: Array
    knots: Array
    sampled_forcing: Modes


@numba.njit(nogil=True, cache=True, error_model="numpy")
def find_interval(knots: Array, t: float) -> tuple[int, float]:
    """Return the index of the knot before ``t`` and the relative position to the next, 0 to 1."""
    k = min(max(int(np.searchsorted(knots, t)) - 1, 0), len(knots) - 2)
    fraction = (t - knots[k]) / (knots[k + 1] - knots[k])
    return k, min(max(fraction, 0.0), 1.0)


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _evaluate_nonlinear(
    kernel: Kernel,
    modes: Modes,
    t: float,
    row: int,
    tendency: TendencyArrays,
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
    for d in range(len(tendency.input_field)):
        if tendency.input_active[row, d]:
            spectra[used] = tendency.input_symbol[d] * modes[tendency.input_field[d]]
            used += 1
    half_shape = shape[:-1] + (shape[-1] // 2 + 1,)
    points = scipy.fft.irfftn(spectra[:used].reshape((used,) + half_shape), shape, axes)
    flat = points.reshape((used, inputs.shape[2]))
    inputs[:fields, 0] = flat[:fields]
    used = fields
    for d in range(len(tendency.input_field)):
        if tendency.input_active[row, d]:
            inputs[fields + d, 0] = flat[used]
            used += 1
    kernel(inputs, tendency.coordinates, t, tendency.weights[row : row + 1], channels)
    chosen = np.nonzero(tendency.channel_active[row])[0]
    out[:] = 0.0
    if len(chosen):
        values = channels[chosen].reshape((len(chosen),) + shape)
        hats = scipy.fft.rfftn(values, shape, axes).reshape((len(chosen), count))
        for k in range(len(chosen)):
            out[tendency.channel_field[chosen[k]]] += tendency.channel_symbol[chosen[k]] * hats[k]
    for k in range(len(tendency.coupling_target)):
        if tendency.coupling_strength[row, k] != 0.0:
            product = tendency.coupling_symbol[k] * modes[tendency.coupling_source[k]]
            out[tendency.coupling_target[k]] += tendency.coupling_strength[row, k] * product
    if len(tendency.knots):
        k, fraction = find_interval(tendency.knots, t)
        out += (1 - fraction) * tendency.sampled_forcing[
            row, k
        ] + fraction * tendency.sampled_forcing[row, k + 1]
    out *= tendency.mask


@numba.njit(nogil=True, cache=True, error_model="numpy")
def integrate_row(
    kernel: Kernel,
    row: int,
    tendency: TendencyArrays,
    steps: StepArrays,
    factors: Modes,
    shape: tuple[int, ...],
    axes: tuple[int, ...],
    counts: tuple[int, int],
    states: Array,
) -> None:
    """Integrate one row of a batch in place; stop when its state is no longer finite.

    Args:
        kernel: evaluates the pointwise functions G.
        row: index of the trajectory.
        tendency: the nonlinear part N.
        steps: the time steps.
        factors: ETDRK4 coefficients full, half, q, first, middle, last,
            ``(length, 6, row or 1, field, mode)``.
        shape: of the grid.
        axes: the grid axes of an array with one leading axis.
        counts: number of inputs and of channels of the kernel.
        states: ``(row, time, field, point)``, with the initial states at time 0 and NaN elsewhere.
    """
    fields, points = states.shape[2:]
    count = factors.shape[-1]
    modes = np.empty((fields, count), np.complex128)
    n_u, n_a = np.empty_like(modes), np.empty_like(modes)
    n_b, n_c = np.empty_like(modes), np.empty_like(modes)
    spectra = np.empty((counts[0], count), np.complex128)
    inputs = np.zeros((counts[0], 1, points))
    channels = np.empty((counts[1], 1, points))
    half_shape = shape[:-1] + (shape[-1] // 2 + 1,)
    saved = 0
    for i in range(len(steps.t)):
        if steps.begins[i]:
            values = states[row, saved].copy().reshape((fields,) + shape)
            modes[:] = scipy.fft.rfftn(values, shape, axes).reshape((fields, count))
            modes *= tendency.mask
        t, h, row_factors = steps.t[i], steps.lengths[steps.h[i]], factors[steps.h[i]]
        i_row = row if row_factors.shape[1] > 1 else 0
        full, half, q = row_factors[0, i_row], row_factors[1, i_row], row_factors[2, i_row]
        first, middle, last = row_factors[3, i_row], row_factors[4, i_row], row_factors[5, i_row]
        arguments = row, tendency, shape, axes, spectra, inputs, channels
        _evaluate_nonlinear(kernel, modes, t, *arguments, n_u)
        linear = half * modes
        a = linear + q * n_u
        _evaluate_nonlinear(kernel, a, t + h / 2, *arguments, n_a)
        _evaluate_nonlinear(kernel, linear + q * n_a, t + h / 2, *arguments, n_b)
        _evaluate_nonlinear(kernel, half * a + q * (2 * n_b - n_u), t + h, *arguments, n_c)
        modes[:] = full * modes + first * n_u + middle * (n_a + n_b) + last * n_c
        if steps.ends[i]:
            saved += 1
            values = scipy.fft.irfftn(modes.reshape((fields,) + half_shape), shape, axes)
            states[row, saved] = values.reshape((fields, points))
            if not np.isfinite(states[row, saved]).all():
                return
