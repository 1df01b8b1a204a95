"""Rates of change of an ODE system with weighted terms, without compilation for each system."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from dashred.physics.backends.stack_machine import evaluate
from dashred.physics.backends.stack_program import (
    NamePlaces,
    StackPrograms,
    build_programs,
    stack_depth,
)
from dashred.physics.solvers.batch_coefficients import CoefficientLayout
from dashred.physics.system import System, Term

Array = NDArray[np.float64]
# In place of a column of the weights that a function does not have.
NO_COLUMN = -1


class OdeRates(NamedTuple):
    """The functions whose sum are the rates of change of the fields.

    The values of the names are those of the fields, the time and the inputs, in this order.

    Attributes:
        programs: of the functions, then of the factors of windows.
        places: the field to which each function is added, the column of its weight and the column
            of its weight within the window, ``(function, 3)``.
        flags: column of the weights that is nonzero if the window of a row has a factor,
            ``(factor,)``.
        inputs: times of the samples, then the values of each input, ``(1 + input, sample)``.
        depth: upper bound of the number of values on the stack.
    """

    programs: StackPrograms
    places: NDArray[np.int64]
    flags: NDArray[np.int64]
    inputs: Array
    depth: int


def build_rates(system: System, terms: Sequence[Term], layout: CoefficientLayout) -> OdeRates:
    """Return the rates ``N(u) + Σ_j (a_j + b_j χ) θ_j(u)`` of a system with terms.

    Args:
        system: an ODE system.
        terms: all terms that a trajectory may have, with lets and parameters resolved.
        layout: columns of the weights a, b and of the factors of the window χ.
    """
    signals = system.input_signals
    index = {name: j for j, name in enumerate([*system.fields, "t", *signals.values])}
    names, channel = NamePlaces(index, {}), {field: i for i, field in enumerate(system.fields)}
    own = [(system.resolved[field], names) for field in system.fields]
    added = [(term.expression, names) for term in terms]
    factors = layout.factors()
    windows = [(factor.expression, NamePlaces(index, factor.unknowns)) for factor in factors]
    places = [[channel[field], NO_COLUMN, NO_COLUMN] for field in system.fields]
    for j, term in enumerate(terms):
        inside = layout.window_column(j)
        places.append([channel[term.equation], j, NO_COLUMN if inside is None else inside])
    programs = build_programs([*own, *added, *windows])
    return OdeRates(
        programs,
        np.array(places, dtype=np.int64),
        np.array([factor.flag for factor in factors], dtype=np.int64),
        np.ascontiguousarray(signals.table),
        stack_depth(programs),
    )


@numba.njit(cache=True, error_model="numpy")
def set_rates(
    rates: OdeRates, used: NDArray[np.int64], states: Array, t: float, weights: Array, out: Array
) -> None:
    """Set ``out`` to the rates of change at one time.

    Args:
        rates: the functions.
        used: indices of the functions with a weight in any row, ``(used,)``.
        states: ``(field, row)``.
        t: the time.
        weights: ``(row, weight)``.
        out: ``(field, row)``.
    """
    fields, count = len(states), len(rates.inputs) - 1
    values, stack = np.empty(fields + 1 + count), np.empty(max(rates.depth, 1))
    values[fields] = t
    for j in range(count):
        values[fields + 1 + j] = np.interp(t, rates.inputs[0], rates.inputs[1 + j])
    ops, arguments, begins = rates.programs
    for row in range(states.shape[1]):
        values[:fields] = states[:, row]
        out[:, row] = 0.0
        window = np.nan
        for k in used:
            channel, everywhere, inside = rates.places[k]
            factor = 1.0 if everywhere < 0 else weights[row, everywhere]
            within = 0.0 if inside < 0 else weights[row, inside]
            if factor == 0.0 and within == 0.0:
                continue
            if within != 0.0:
                if np.isnan(window):
                    window = _window(rates, values, weights[row], stack)
                factor += within * window
            found = evaluate(ops, arguments, begins[k], begins[k + 1], values, weights[row], stack)
            out[channel, row] += factor * found


@numba.njit(cache=True, error_model="numpy")
def _window(rates: OdeRates, values: Array, weights: Array, stack: Array) -> float:
    """Return the window χ of one row: the product of its factors."""
    ops, arguments, begins = rates.programs
    result, first = 1.0, len(rates.places)
    for j in range(len(rates.flags)):
        if weights[rates.flags[j]] != 0.0:
            begin, end = begins[first + j], begins[first + j + 1]
            result *= evaluate(ops, arguments, begin, end, values, weights, stack)
    return result
