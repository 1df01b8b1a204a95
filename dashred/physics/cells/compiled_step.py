"""Exponential steps of a batch of finite volumes, in machine code.

All arrays of matrices are transposed, so that a row of a batch is a row of a product.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from dashred.physics.backends.knot_intervals import find_interval
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
        strengths: coefficient of each linear term, ``(linear, row)``.
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
        clock: times of its first, middle and last stages, ``(step, 3)``.
        kinds: index of its matrices, ``(step,)``.
        ends: whether it ends at an output time, ``(step,)``.
        given: given values at these times, ``(step, 3, given)``.
        matrices: full, half, stage, first, middle and last of each length, ``(kind, 6, n, n)``;
            see :class:`.exponential.StepMatrices`.
    """

    clock: Array
    kinds: Indices
    ends: NDArray[np.bool_]
    given: Array
    matrices: Array


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _products(x: Array, x_matrix: Array, y: Array, y_matrix: Array) -> Array:
    """Return ``x X + y Y``, ``(row, column)``; y may be one row for all."""
    found, other = np.dot(x, x_matrix), np.dot(y, y_matrix)
    for row in range(len(found)):
        second = other[row if len(other) > 1 else 0]
        for k in range(len(second)):
            found[row, k] += second[k]
    return found


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _add(terms: Array, factors: Array, out: Array) -> None:
    """Add ``factors[row] terms[row]`` to ``out[row]`` for each row; one factor may be for all."""
    for row in range(len(out)):
        factor = factors[row if len(factors) > 1 else 0]
        for k in range(out.shape[1]):
            out[row, k] += factor * terms[row, k]


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
    for k in arrays.inputs:
        values[k] = _products(cells, arrays.input_matrices[k], given, arrays.input_given[k])
    kernel(values, arrays.coordinates, t, arrays.weights, results)
    out, one = np.zeros_like(cells), np.ones(1)
    for k in arrays.channels:
        _add(np.dot(results[k], arrays.channel_matrices[k]), one, out)
    for k in range(len(arrays.linear)):
        linear = _products(cells, arrays.linear[k], given, arrays.linear_given[k])
        _add(linear, arrays.strengths[k], out)
    if len(arrays.knots):
        k, share = find_interval(arrays.knots, t)
        _add(arrays.forcing[k], (1 - share) * one, out)
        _add(arrays.forcing[k + 1], share * one, out)
    return out


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _stages(
    kernel: Kernel,
    arrays: CellArrays,
    own: Array,
    clock: Array,
    given: Array,
    values: Array,
    results: Array,
    cells: Array,
) -> tuple[Array, Array, Array, Array]:
    """Return the cells at stages a, b and c and at the end of a step, ``(row, n)`` each.

    ``own`` holds the matrices of the step and ``given`` the given values at the times
    ``clock`` of its first, middle and last stages; ``values`` and ``results`` are work arrays.
    """
    one = np.ones(1)
    n = _rest(kernel, arrays, cells, given[0:1], clock[0], values, results)
    a = _products(cells, own[1], n, own[2])
    n_a = _rest(kernel, arrays, a, given[1:2], clock[1], values, results)
    b = _products(cells, own[1], n_a, own[2])
    n_b = _rest(kernel, arrays, b, given[1:2], clock[1], values, results)
    ahead = n_b.copy()
    _add(n_b, one, ahead)
    _add(n, -one, ahead)
    c = _products(a, own[1], ahead, own[2])
    n_c = _rest(kernel, arrays, c, given[2:3], clock[2], values, results)
    end = _products(cells, own[0], n, own[3])
    _add(n_b, one, n_a)
    _add(_products(n_a, own[4], n_c, own[5]), one, end)
    return a, b, c, end


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
    for i in range(len(steps.kinds)):
        clock, own = steps.clock[i], steps.matrices[steps.kinds[i]]
        work = steps.given[i], values, results
        _, _, _, cells = _stages(kernel, arrays, own, clock, *work, cells)
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
    for i in range(len(steps.kinds)):
        clock, own = steps.clock[i], steps.matrices[steps.kinds[i]]
        work = steps.given[i], values, results
        a, b, c, end = _stages(kernel, arrays, own, clock, *work, cells)
        saved[i, 0], saved[i, 1], saved[i, 2] = cells[0], a[0], b[0]
        saved[i, 3], saved[i, 4] = c[0], end[0]
        cells = end
