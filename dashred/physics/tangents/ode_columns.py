"""Integrate an ODE trajectory together with its tangents, in compiled code."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from dashred.physics.backends.knot_intervals import find_interval
from dashred.physics.backends.stack_machine import evaluate
from dashred.physics.backends.stack_program import StackPrograms

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class LinearizedRates(NamedTuple):
    """Rates of change with their derivatives; names are the fields, the time and the inputs.

    Attributes:
        programs: of the functions, then of their slopes, then of the sources.
        functions: the field to which each function is added, ``(function,)``.
        weights: weight of each function, ``(function,)``.
        slopes: function, and field by which it is differentiated, ``(slope, 2)``.
        sources: column and field to which each source is added, ``(source, 2)``.
        inputs: times of the samples, then the values of each input, ``(1 + input, sample)``.
        depth: upper bound of the number of values on the stack.
    """

    programs: StackPrograms
    functions: Indices
    weights: Array
    slopes: Indices
    sources: Indices
    inputs: Array
    depth: int


class KnotForcing(NamedTuple):
    """A free forcing that is linear between knots, and the basis of its columns.

    Attributes:
        knots: times of the forcing, ``(knot,)``; empty without one.
        values: the forcing at its knots, ``(knot, field)``.
        basis_knots: times of the basis, ``(knot,)``; empty without one.
        basis: the courses at these knots, ``(knot, course)``.
        first: index of the first column of the basis. It has one column for each field and course.
    """

    knots: Array
    values: Array
    basis_knots: Array
    basis: Array
    first: int


@numba.njit(cache=True, error_model="numpy")
def integrate_columns(
    rates: LinearizedRates,
    forcing: KnotForcing,
    times: Array,
    steps: Array,
    ends: NDArray[np.bool_],
    a: Array,
    b: Array,
    c: Array,
    states: Array,
    columns: Array,
) -> None:
    """Fill in the states and the tangents at all output times after the first.

    The same method steps both, so the tangents are the exact derivatives of the discrete
    trajectory.

    Args:
        rates: the functions.
        forcing: the free forcing.
        times: start of each step, ``(step,)``.
        steps: length of each step, ``(step,)``.
        ends: whether the step ends at an output time, ``(step,)``.
        a: coefficients of the method's tableau, ``(stage, stage)``.
        b: its weights, ``(stage,)``.
        c: its nodes, ``(stage,)``.
        states: ``(time, field)``.
        columns: ``(time, column, field)``.
    """
    y, v = states[0].copy(), columns[0].copy()
    at, column = np.empty_like(y), np.empty_like(v)
    rate, velocity = np.empty((len(b), len(y))), np.empty((len(b), *v.shape))
    jacobian, source = np.empty((len(y), len(y))), np.empty_like(v)
    values = np.empty(len(y) + len(rates.inputs))
    stack = np.empty(max(rates.depth, 1))
    output = 0
    for i in range(len(times)):
        h = steps[i]
        for stage in range(len(b)):
            at[:], column[:] = y, v
            for j in range(stage):
                if a[stage, j] != 0.0:
                    at += h * a[stage, j] * rate[j]
                    column += h * a[stage, j] * velocity[j]
            t = times[i] + c[stage] * h
            _read(rates, at, t, values)
            _set_rate(rates, values, stack, rate[stage])
            _set_jacobian(rates, values, stack, jacobian)
            _set_source(rates, values, stack, source)
            _add_forcing(forcing, t, rate[stage], source)
            velocity[stage] = source
            _add_product(column, jacobian, velocity[stage])
        for stage in range(len(b)):
            y += h * b[stage] * rate[stage]
            v += h * b[stage] * velocity[stage]
        if ends[i]:
            output += 1
            states[output], columns[output] = y, v


@numba.njit(cache=True, error_model="numpy")
def _read(rates: LinearizedRates, state: Array, t: float, values: Array) -> None:
    """Set the values of the names."""
    fields = len(state)
    values[:fields] = state
    values[fields] = t
    for j in range(1, len(rates.inputs)):
        values[fields + j] = np.interp(t, rates.inputs[0], rates.inputs[j])


@numba.njit(cache=True, error_model="numpy")
def _value(rates: LinearizedRates, program: int, values: Array, stack: Array) -> float:
    ops, arguments, begins = rates.programs
    return evaluate(
        ops, arguments, begins[program], begins[program + 1], values, rates.weights, stack
    )


@numba.njit(cache=True, error_model="numpy")
def _set_rate(rates: LinearizedRates, values: Array, stack: Array, out: Array) -> None:
    out[:] = 0.0
    for k in range(len(rates.functions)):
        if rates.weights[k] != 0.0:
            out[rates.functions[k]] += rates.weights[k] * _value(rates, k, values, stack)


@numba.njit(cache=True, error_model="numpy")
def _set_jacobian(rates: LinearizedRates, values: Array, stack: Array, out: Array) -> None:
    """Set ``out`` to the derivative of each rate by each field, ``(rate, field)``."""
    out[:] = 0.0
    first = len(rates.functions)
    for j in range(len(rates.slopes)):
        function, field = rates.slopes[j]
        weight = rates.weights[function]
        if weight != 0.0:
            slope = _value(rates, first + j, values, stack)
            out[rates.functions[function], field] += weight * slope


@numba.njit(cache=True, error_model="numpy")
def _set_source(rates: LinearizedRates, values: Array, stack: Array, out: Array) -> None:
    """Set ``out`` to the sources of the columns, ``(column, field)``."""
    out[:] = 0.0
    first = len(rates.functions) + len(rates.slopes)
    for j in range(len(rates.sources)):
        column, field = rates.sources[j]
        out[column, field] += _value(rates, first + j, values, stack)


@numba.njit(cache=True, error_model="numpy")
def _add_forcing(forcing: KnotForcing, t: float, rate: Array, source: Array) -> None:
    """Add the free forcing to the rates, and its basis to the sources."""
    if len(forcing.knots):
        k, share = find_interval(forcing.knots, t)
        rate += (1 - share) * forcing.values[k] + share * forcing.values[k + 1]
    if len(forcing.basis_knots):
        k, share = find_interval(forcing.basis_knots, t)
        courses = forcing.basis.shape[1]
        for course in range(courses):
            height = (1 - share) * forcing.basis[k, course] + share * forcing.basis[k + 1, course]
            for field in range(len(rate)):
                source[forcing.first + field * courses + course, field] += height


@numba.njit(cache=True, error_model="numpy")
def _add_product(columns: Array, jacobian: Array, out: Array) -> None:
    """Add ``columns @ jacobian.T``; the matrices are too small for a library call."""
    for k in range(len(columns)):
        for row in range(len(jacobian)):
            total = 0.0
            for field in range(len(jacobian)):
                total += jacobian[row, field] * columns[k, field]
            out[k, row] += total
