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
def integrate_batch(
    kernel: Kernel,
    arrays: CellArrays,
    matrices: Array,
    begins: Array,
    lengths: Array,
    kinds: Indices,
    ends: NDArray[np.bool_],
    given: Array,
    counts: tuple[int, int],
    saved: Array,
) -> None:
    """Integrate all rows of a batch together.

    Args:
        kernel: evaluates the pointwise functions.
        arrays: N.
        matrices: full, half, stage, first, middle and last of each length, ``(length, 6, n, n)``;
            see :class:`.exponential.StepMatrices`.
        begins, lengths: start time and length of each step, ``(step,)``.
        kinds: index of its matrices, ``(step,)``.
        ends: whether it ends at an output time, ``(step,)``.
        given: given values at the start, middle and end of each step, ``(step, 3, given)``.
        counts: number of inputs and of channels of the kernel.
        saved: cells at the output times, ``(time, row, n)``, with those at the start; written.
    """
    cells, points = saved[0].copy(), arrays.coordinates.shape[1]
    values = np.zeros((counts[0], len(cells), points))
    results = np.empty((counts[1], len(cells), points))
    output = 0
    for i in range(len(begins)):
        t, h, own = begins[i], lengths[i], matrices[kinds[i]]
        g, middle, end = given[i, 0:1], given[i, 1:2], given[i, 2:3]
        n = _rest(kernel, arrays, cells, g, t, values, results)
        damped = cells @ own[1]
        a = damped + n @ own[2]
        n_a = _rest(kernel, arrays, a, middle, t + h / 2, values, results)
        b = damped + n_a @ own[2]
        n_b = _rest(kernel, arrays, b, middle, t + h / 2, values, results)
        c = a @ own[1] + (2 * n_b - n) @ own[2]
        n_c = _rest(kernel, arrays, c, end, t + h, values, results)
        cells = cells @ own[0] + n @ own[3] + (n_a + n_b) @ own[4] + n_c @ own[5]
        if ends[i]:
            output += 1
            saved[output] = cells
