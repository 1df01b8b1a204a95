"""ETDRK4 time steps of one trajectory in machine code, including the Fourier transforms.

On grids of a few hundred points, the overhead of calling array operations exceeds their cost.
Compiled code avoids these calls. The code releases the GIL, so several threads can integrate
different rows of one batch.

The code has loops instead of array expressions and assignments to slices, because Numba needs
several times as long to compile those.
"""

# ruff: noqa: RUF005 (Numba does not compile unpacking into a tuple)

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numba
import numpy as np
import scipy.fft
from numpy.typing import NDArray

from dashred.physics.backends.knot_intervals import find_interval
from dashred.physics.backends.numba_backend import Array, Kernel
from dashred.physics.solvers.schedule import Step

Modes = NDArray[np.complex128]
Indices = NDArray[np.int64]
STAGES = 4
"""Stages of a step."""
NODES = (0.0, 0.5, 0.5, 1.0)
"""Times of the stages within a step, as shares of its length."""


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

    @classmethod
    def of(cls, steps: Sequence[Step]) -> StepArrays:
        """Return steps as arrays."""
        lengths = list(dict.fromkeys(step.h for step in steps))
        index = {h: i for i, h in enumerate(lengths)}
        return cls(
            t=np.array([step.t for step in steps]),
            h=np.array([index[step.h] for step in steps], dtype=np.int64),
            lengths=np.array(lengths),
            begins=np.array([step.begins for step in steps]),
            ends=np.array([step.ends for step in steps]),
        )


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
def _to_modes(points: Array, shape: tuple[int, ...], axes: tuple[int, ...]) -> Modes:
    """Return the modes ``(field, mode)`` of the values on the grid ``(field, …, point)``."""
    fields = len(points)
    hats = scipy.fft.rfftn(points.reshape((fields,) + shape), shape, axes)
    return hats.reshape((fields, hats.size // fields))


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _to_points(modes: Modes, shape: tuple[int, ...], axes: tuple[int, ...]) -> Array:
    """Return the values on the grid ``(field, point)`` of the modes ``(field, mode)``."""
    fields = len(modes)
    half_shape = shape[:-1] + (shape[-1] // 2 + 1,)
    values = scipy.fft.irfftn(modes.reshape((fields,) + half_shape), shape, axes)
    return values.reshape((fields, values.size // fields))


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _copy(source: Array | Modes, target: Array | Modes) -> None:
    """Set ``target = source``, ``(row, entry)``."""
    for row in range(len(source)):
        for k in range(source.shape[1]):
            target[row, k] = source[row, k]


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _mask(modes: Modes, mask: Array) -> None:
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
    fields = len(modes)
    _copy(modes, spectra)
    used = fields
    for d in range(len(tendency.input_field)):
        if tendency.input_active[row, d]:
            spectra[used] = 0.0
            _add_product(
                tendency.input_symbol[d], modes[tendency.input_field[d]], 1.0, spectra[used]
            )
            used += 1
    flat = _to_points(spectra[:used], shape, axes)
    _copy(flat[:fields], inputs[:, 0])
    used = fields
    for d in range(len(tendency.input_field)):
        if tendency.input_active[row, d]:
            _copy(flat[used : used + 1], inputs[fields + d])
            used += 1
    kernel(inputs, tendency.coordinates, t, tendency.weights[row : row + 1], channels)
    chosen = np.nonzero(tendency.channel_active[row])[0]
    out[:] = 0.0
    if len(chosen):
        hats = _to_modes(channels[chosen], shape, axes)
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
    _mask(out, tendency.mask)


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _advance(
    kernel: Kernel,
    row: int,
    tendency: TendencyArrays,
    factors: Modes,
    t: float,
    h: float,
    shape: tuple[int, ...],
    axes: tuple[int, ...],
    spectra: Modes,
    inputs: Array,
    channels: Array,
    modes: Modes,
    stages: Modes,
    rates: Modes,
) -> None:
    """Advance the modes ``(field, mode)`` of one trajectory by one step, in place.

    Args:
        kernel: evaluates the pointwise functions G.
        row: index of the trajectory.
        tendency: the nonlinear part N.
        factors: ETDRK4 coefficients of this step, ``(6, row or 1, field, mode)``.
        t: start time of the step.
        h: its length.
        shape: of the grid.
        axes: the grid axes of an array with one leading axis.
        spectra: work array of the inputs in modes.
        inputs: work array of the inputs on the grid.
        channels: work array of the channels on the grid.
        modes: the modes.
        stages: modes of the stages u, a, b and c, ``(4, field, mode)``; written.
        rates: N of the stages, ``(4, field, mode)``; written.
    """
    place = row if factors.shape[1] > 1 else 0
    full, half, q = factors[0, place], factors[1, place], factors[2, place]
    first, middle, last = factors[3, place], factors[4, place], factors[5, place]
    arguments = row, tendency, shape, axes, spectra, inputs, channels
    _copy(modes, stages[0])
    # One call for all stages: LLVM would copy the code of N to each call.
    for stage in range(STAGES):
        at = stages[stage]
        for f in range(len(modes)):
            for k in range(modes.shape[1]):
                if stage == 3:
                    ahead = 2 * rates[2, f, k] - rates[0, f, k]
                    at[f, k] = half[f, k] * stages[1, f, k] + q[f, k] * ahead
                elif stage > 0:
                    at[f, k] = half[f, k] * modes[f, k] + q[f, k] * rates[stage - 1, f, k]
        _evaluate_nonlinear(kernel, at, t + NODES[stage] * h, *arguments, rates[stage])
    for f in range(len(modes)):
        for k in range(modes.shape[1]):
            both = rates[1, f, k] + rates[2, f, k]
            begin = full[f, k] * modes[f, k] + first[f, k] * rates[0, f, k]
            modes[f, k] = begin + middle[f, k] * both + last[f, k] * rates[3, f, k]


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
    stages = np.empty((STAGES, fields, count), np.complex128)
    rates = np.empty_like(stages)
    work = _work_arrays(counts, count, points)
    saved = 0
    for i in range(len(steps.t)):
        if steps.begins[i]:
            _copy(_to_modes(states[row, saved].copy(), shape, axes), modes)
            _mask(modes, tendency.mask)
        t, h, own = steps.t[i], steps.lengths[steps.h[i]], factors[steps.h[i]]
        _advance(kernel, row, tendency, own, t, h, shape, axes, *work, modes, stages, rates)
        if steps.ends[i]:
            saved += 1
            _copy(_to_points(modes, shape, axes), states[row, saved])
            if not np.isfinite(states[row, saved]).all():
                return


@numba.njit(nogil=True, cache=True, error_model="numpy")
def integrate_stages(
    kernel: Kernel,
    tendency: TendencyArrays,
    steps: StepArrays,
    factors: Modes,
    shape: tuple[int, ...],
    axes: tuple[int, ...],
    counts: tuple[int, int],
    modes: Modes,
    states: Array,
    stages: Modes,
    rates: Modes,
) -> None:
    """Integrate some steps of the first row of a batch, and keep all stages.

    Args:
        kernel: evaluates the pointwise functions G.
        tendency: the nonlinear part N.
        steps: the time steps.
        factors: ETDRK4 coefficients as in :func:`integrate_row`.
        shape: of the grid.
        axes: the grid axes of an array with one leading axis.
        counts: number of inputs and of channels of the kernel.
        modes: modes of the state, ``(field, mode)``; advanced in place.
        states: states at the output times, ``(output, field, point)``; written.
        stages: modes of the stages u, a, b and c of each step, ``(step, 4, field, mode)``; written.
        rates: N of the stages, ``(step, 4, field, mode)``; written.
    """
    work = _work_arrays(counts, modes.shape[1], states.shape[2])
    saved = 0
    for i in range(len(steps.t)):
        if steps.begins[i]:
            _copy(_to_modes(_to_points(modes, shape, axes), shape, axes), modes)
            _mask(modes, tendency.mask)
        t, h, own = steps.t[i], steps.lengths[steps.h[i]], factors[steps.h[i]]
        _advance(kernel, 0, tendency, own, t, h, shape, axes, *work, modes, stages[i], rates[i])
        if steps.ends[i]:
            _copy(_to_points(modes, shape, axes), states[saved])
            saved += 1


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _work_arrays(counts: tuple[int, int], modes: int, points: int) -> tuple[Modes, Array, Array]:
    """Return the work arrays of the nonlinear part: spectra, inputs and channels."""
    spectra = np.empty((counts[0], modes), np.complex128)
    return spectra, np.zeros((counts[0], 1, points)), np.empty((counts[1], 1, points))
