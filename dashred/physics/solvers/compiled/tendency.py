"""The nonlinear part of one trajectory's tendency in machine code, with its Fourier transforms.

On grids of a few hundred points, the overhead of calling array operations exceeds their cost.
Compiled code avoids these calls.

The code has loops instead of array expressions and assignments to slices, because Numba needs
several times as long to compile those.
"""

# ruff: noqa: RUF005 (Numba does not compile unpacking into a tuple)

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
import scipy.fft
from numpy.typing import NDArray

from dashred.physics.backends.knot_intervals import find_interval
from dashred.physics.backends.numba_backend import Array, Kernel

Modes = NDArray[np.complex128]
Indices = NDArray[np.int64]


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
def to_modes(points: Array, shape: tuple[int, ...], axes: tuple[int, ...]) -> Modes:
    """Return the modes ``(field, mode)`` of the values on the grid ``(field, …, point)``."""
    fields = len(points)
    hats = scipy.fft.rfftn(points.reshape((fields,) + shape), shape, axes)
    return hats.reshape((fields, hats.size // fields))


@numba.njit(nogil=True, cache=True, error_model="numpy")
def to_points(modes: Modes, shape: tuple[int, ...], axes: tuple[int, ...]) -> Array:
    """Return the values on the grid ``(field, point)`` of the modes ``(field, mode)``."""
    fields = len(modes)
    half_shape = shape[:-1] + (shape[-1] // 2 + 1,)
    values = scipy.fft.irfftn(modes.reshape((fields,) + half_shape), shape, axes)
    return values.reshape((fields, values.size // fields))


@numba.njit(nogil=True, cache=True, error_model="numpy")
def copy_rows(source: Array | Modes, target: Array | Modes) -> None:
    """Set ``target = source``, ``(row, entry)``."""
    for row in range(len(source)):
        for k in range(source.shape[1]):
            target[row, k] = source[row, k]


@numba.njit(nogil=True, cache=True, error_model="numpy")
def mask_modes(modes: Modes, mask: Array) -> None:
    """Set ``modes *= mask``, ``(field, mode)`` and ``(mode,)``."""
    for field in range(len(modes)):
        for k in range(len(mask)):
            modes[field, k] *= mask[k]


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _add_product(factor: Modes, source: Modes, strength: float, target: Modes) -> None:
    """Set ``target += strength factor source``, ``(entry,)``."""
    for k in range(len(target)):
        target[k] += strength * (factor[k] * source[k])


@numba.njit(nogil=True, cache=True, error_model="numpy")
def evaluate_nonlinear(
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
    fields = len(modes)
    copy_rows(modes, spectra)
    used = fields
    for d in range(len(tendency.input_field)):
        if tendency.input_active[row, d]:
            spectra[used] = 0.0
            _add_product(
                tendency.input_symbol[d], modes[tendency.input_field[d]], 1.0, spectra[used]
            )
            used += 1
    flat = to_points(spectra[:used], shape, axes)
    copy_rows(flat[:fields], inputs[:, 0])
    used = fields
    for d in range(len(tendency.input_field)):
        if tendency.input_active[row, d]:
            copy_rows(flat[used : used + 1], inputs[fields + d])
            used += 1
    kernel(inputs, tendency.coordinates, t, tendency.weights[row : row + 1], channels)
    chosen = np.nonzero(tendency.channel_active[row])[0]
    out[:] = 0.0
    if len(chosen):
        hats = to_modes(channels[chosen], shape, axes)
        for k in range(len(chosen)):
            target = out[tendency.channel_field[chosen[k]]]
            _add_product(tendency.channel_symbol[chosen[k]], hats[k], 1.0, target)
    for k in range(len(tendency.coupling_target)):
        strength = tendency.coupling_strength[row, k]
        if strength != 0.0:
            source, target = modes[tendency.coupling_source[k]], out[tendency.coupling_target[k]]
            _add_product(tendency.coupling_symbol[k], source, strength, target)
    if len(tendency.knots):
        k, fraction = find_interval(tendency.knots, t)
        before, after = tendency.sampled_forcing[row, k], tendency.sampled_forcing[row, k + 1]
        for field in range(fields):
            for m in range(out.shape[1]):
                out[field, m] += (1 - fraction) * before[field, m] + fraction * after[field, m]
    mask_modes(out, tendency.mask)


@numba.njit(nogil=True, cache=True, error_model="numpy")
def work_arrays(counts: tuple[int, int], modes: int, points: int) -> tuple[Modes, Array, Array]:
    """Return the work arrays of the nonlinear part: spectra, inputs and channels."""
    spectra = np.empty((counts[0], modes), np.complex128)
    return spectra, np.zeros((counts[0], 1, points)), np.empty((counts[1], 1, points))
