"""Exponential steps of a batch of finite volumes, in machine code.

All arrays of matrices are transposed, so that a row of a batch is a row of a product.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from dashred.physics.backends.numba_backend import Array, Kernel

Indices = NDArray[np.int64]


class CellArrays(NamedTuple):
    """The part N of ``v' = A v + N(v, t)`` of a batch, as arrays.

    The given values g of the conditions are ``(given,)`` at any time.

    Attributes:
        inputs: the inputs that are read, ``(input,)``.
        input_matrices: from cells, ``(input, n, point)``.
        input_given: from given values, ``(input, given, point)``.
        channels: the channels that are written, ``(channel,)``.
        channel_matrices: to cells, ``(channel, point, n)``.
        linear: of the linear terms beyond A, ``(linear, n, n)``.
        linear_given: from given values, ``(linear, given, n)``.
        strengths: coefficient of each linear term, ``(linear, row, 1)``.
        coordinates: of the points, ``(coordinate, point)``.
        weights: coefficients of the terms, ``(row, column)``.
        knots: interpolation times of the free forcing, ``(knot,)``; empty without one.
        forcing: the free forcing at cells, ``(knot, row, n)``.
    """

    inputs: Indices
    input_matrices: Array
    input_given: Array
    channels: Indices
    channel_matrices: Array
    linear: Array
    linear_given: Array
    strengths: Array
    coordinates: Array
    weights: Array
    knots: Array
    forcing: Array


class CellSteps(NamedTuple):
    """Time steps as arrays.

    Attributes:
        t, h: start time and length of each step, ``(step,)``.
        kinds: index of its matrices, ``(step,)``.
        ends: whether it ends at an output time, ``(step,)``.
        given: given values at its start, middle and end, ``(step, 3, given)``.
        matrices: full, half, stage, first, middle and last of each length, ``(kind, 6, n, n)``;
            see :class:`.exponential.StepMatrices`.
    """

    t: Array
    h: Array
    kinds: Indices
    ends: NDArray[np.bool_]
    given: Array
    matrices: Array


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _rest(
    kernel: Kernel,
    arrays: CellArrays,
    cells: Array,
    given: Array,
    t: float,
    values: Array,
    results: Array,
) -> Array:
    """Return N, ``(row, n)``, of cells ``(row, n)`` with given values ``(1, given)``."""
    for i in range(len(arrays.inputs)):
        k = arrays.inputs[i]
        values[k] = cells @ arrays.input_matrices[k] + given @ arrays.input_given[k]
    kernel(values, arrays.coordinates, t, arrays.weights, results)
    out = np.zeros_like(cells)
    for i in range(len(arrays.channels)):
        k = arrays.channels[i]
        out += results[k] @ arrays.channel_matrices[k]
    for k in range(len(arrays.linear)):
        linear = cells @ arrays.linear[k] + given @ arrays.linear_given[k]
        out += arrays.strengths[k] * linear
    if len(arrays.knots):
        knots = arrays.knots
        k = min(max(int(np.searchsorted(knots, t)) - 1, 0), len(knots) - 2)
        share = min(max((t - knots[k]) / (knots[k + 1] - knots[k]), 0.0), 1.0)
        out += (1 - share) * arrays.forcing[k] + share * arrays.forcing[k + 1]
    return out


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _stages(
    kernel: Kernel,
    arrays: CellArrays,
    own: Array,
    t: float,
    h: float,
    given: Array,
    values: Array,
    results: Array,
    cells: Array,
) -> tuple[Array, Array, Array, Array]:
    """Return the cells at stages a, b and c and at the end of a step, ``(row, n)`` each.

    ``own`` holds the matrices of the step and ``given`` the given values at its start, middle and
    end; ``values`` and ``results`` are work arrays.
    """
    n = _rest(kernel, arrays, cells, given[0:1], t, values, results)
    damped = cells @ own[1]
    a = damped + n @ own[2]
    n_a = _rest(kernel, arrays, a, given[1:2], t + h / 2, values, results)
    b = damped + n_a @ own[2]
    n_b = _rest(kernel, arrays, b, given[1:2], t + h / 2, values, results)
    c = a @ own[1] + (2 * n_b - n) @ own[2]
    n_c = _rest(kernel, arrays, c, given[2:3], t + h, values, results)
    return a, b, c, cells @ own[0] + n @ own[3] + (n_a + n_b) @ own[4] + n_c @ own[5]


@numba.njit(nogil=True, cache=True, error_model="numpy")
def integrate_batch(
    kernel: Kernel,
    arrays: CellArrays,
    steps: CellSteps,
    counts: tuple[int, int],
    saved: Array,
) -> None:
    """Integrate all rows of a batch together.

    Args:
        kernel: evaluates the pointwise functions.
        arrays: N.
        steps: the steps.
        counts: number of inputs and of channels of the kernel.
        saved: cells at the output times, ``(time, row, n)``, with those at the start; written.
    """
    cells, points = saved[0].copy(), arrays.coordinates.shape[1]
    values = np.zeros((counts[0], len(cells), points))
    results = np.empty((counts[1], len(cells), points))
    output = 0
    for i in range(len(steps.t)):
        t, h, own = steps.t[i], steps.h[i], steps.matrices[steps.kinds[i]]
        work = steps.given[i], values, results
        _, _, _, cells = _stages(kernel, arrays, own, t, h, *work, cells)
        if steps.ends[i]:
            output += 1
            saved[output] = cells


@numba.njit(nogil=True, cache=True, error_model="numpy")
def integrate_stages(
    kernel: Kernel,
    arrays: CellArrays,
    steps: CellSteps,
    counts: tuple[int, int],
    saved: Array,
) -> None:
    """Integrate one row and keep all stages.

    Args:
        kernel: evaluates the pointwise functions.
        arrays: N.
        steps: the steps.
        counts: number of inputs and of channels of the kernel.
        saved: cells at stages u, a, b and c and at the end of each step, ``(step, 5, n)``, with
            those at the start of the first step; written.
    """
    cells, points = saved[0, 0:1].copy(), arrays.coordinates.shape[1]
    values = np.zeros((counts[0], 1, points))
    results = np.empty((counts[1], 1, points))
    for i in range(len(steps.t)):
        t, h, own = steps.t[i], steps.h[i], steps.matrices[steps.kinds[i]]
        work = steps.given[i], values, results
        a, b, c, end = _stages(kernel, arrays, own, t, h, *work, cells)
        saved[i, 0], saved[i, 1], saved[i, 2] = cells[0], a[0], b[0]
        saved[i, 3], saved[i, 4] = c[0], end[0]
        cells = end
