"""``N(u, t)`` of equations in semilinear form, in Fourier modes, evaluated by NumPy.

On a few hundred points, call overhead dominates. NumPy's overhead is a fifth of torch's. One FFT
transforms all inputs, and one transforms all channels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from dashred.physics.backends.knot_intervals import find_interval
from dashred.physics.backends.numpy_backend import Array, Pointwise
from dashred.physics.expressions.algebra import Expr, add, scale
from dashred.physics.expressions.semilinear import Input, SemilinearForm, semilinear_form
from dashred.physics.forcing_basis import SampledForcing
from dashred.physics.grids.fourier_symbols import symbols
from dashred.physics.grids.spectral import Spectral
from dashred.physics.grids.transforms import from_modes, to_modes
from dashred.physics.solvers.etdrk4 import coefficients
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.rhs import dealias_mask
from dashred.physics.system import System, Term

Modes = NDArray[Any]
"""Modes of the fields, ``(field, state, *modes)`` unless stated otherwise."""


def forced_semilinear_form(system: System, forcing: Forcing | None) -> SemilinearForm:
    """Return the semilinear form of the equations with the forcing of one trajectory.

    Raises:
        NotSemilinearError, ArithmeticError: see :func:`.semilinear.semilinear_form`.
    """
    added = ([], []) if forcing is None else (forcing.terms, forcing.coefficients[0].tolist())
    return semilinear_form(with_terms(system, *added), [axis.name for axis in system.axes])


def with_terms(
    system: System, terms: Sequence[Term], coefficients: Sequence[float]
) -> dict[str, Expr]:
    """Return the resolved equations with terms added."""
    found = {field: [expr] for field, expr in system.resolved.items()}
    for term, coefficient in zip(terms, coefficients, strict=True):
        found[term.equation].append(scale(coefficient, term.expression))
    return {field: add(parts) for field, parts in found.items()}


def operator_symbol(system: System, operator: Expr) -> Modes:
    """Return the Fourier symbol of an operator on one field, ``(*modes)``."""
    assert isinstance(system.operators, Spectral)
    result: Modes = symbols([[operator]], system.operators, torch.device("cpu"))[0].numpy()
    return result


def mode_mask(system: System) -> Modes:
    """Return the mask of the 2/3 rule, ``(*modes)``; all ones if the integrator does not use it."""
    *first, last = system.grid.shape
    if system.config.integrator.dealias:
        return dealias_mask(system).numpy()
    return np.ones((*first, last // 2 + 1))


class Inputs:
    """Inputs ``v = V f`` of the pointwise functions, on the grid.

    Attributes:
        fields: index of the field of each input.
        multipliers: V, ``(input, 1, *modes)``.
    """

    def __init__(self, system: System, inputs: Mapping[str, Input]) -> None:
        self.names, self.shape = tuple(inputs), system.grid.shape
        self.fields = np.array([system.fields.index(v.field) for v in inputs.values()], dtype=int)
        result = [operator_symbol(system, v.operator)[None] for v in inputs.values()]
        self.multipliers = np.array(result)

    def __call__(self, modes: Modes) -> Array:
        """Return the inputs, ``(input, state, *grid)``."""
        if not self.names:
            return np.empty((0, modes.shape[1], *self.shape))
        return from_modes(modes[self.fields] * self.multipliers, self.shape)

    def named(self, points: Array) -> dict[str, Array]:
        """Return the inputs by name."""
        return dict(zip(self.names, points, strict=True))


class SemilinearTendency:
    """``û' = Lû + N(û, t)`` of a system with one forcing and one free forcing.

    Attributes:
        form: the semilinear form of the equations.
        linear: L, ``(field, 1, *modes)``.
        coefficients: of ETDRK4 for a step length, each in the shape of L; cached.
        channel_symbols: D, ``(channel, 1, *modes)``; zero for modes removed by the 2/3 rule.
        channel_equations: index of the equation of each channel.
        couplings: ``(equation, field, C)``; C is zero for modes removed by the 2/3 rule.
    """

    def __init__(
        self, system: System, forcing: Forcing | None, sampled_forcing: SampledForcing | None = None
    ) -> None:
        assert isinstance(system.operators, Spectral)
        self.form = forced_semilinear_form(system, forcing)
        index = {field: i for i, field in enumerate(system.fields)}
        linear = list(self.form.linear.values())
        self.linear = symbols(linear, system.operators, torch.device("cpu"))[:, None]
        self.coefficients = cache(lambda h: [c.numpy() for c in coefficients(self.linear, h)])
        self.inputs = Inputs(system, self.form.inputs)
        self.rank, self.mask = len(system.grid.shape), mode_mask(system)
        result = [self.mask * operator_symbol(system, c.operator) for c in self.form.channels]
        self.channel_symbols = np.array(result)[:, None]
        self.channel_equations = [index[channel.equation] for channel in self.form.channels]
        self.couplings = [
            (index[equation], index[field], self.mask * operator_symbol(system, operator))
            for equation, couplings in self.form.couplings.items()
            for field, operator in couplings.items()
        ]
        self._channel_bodies = Pointwise([channel.body for channel in self.form.channels])
        self._coordinates = {k: v.numpy() for k, v in system.grid.places.items()}
        self._input_signals = system.input_signals
        self._knots: Array = (
            np.zeros(0) if sampled_forcing is None else sampled_forcing.knots.numpy()
        )
        if sampled_forcing is not None:
            hats = to_modes(sampled_forcing.values[0].numpy(), self.rank)
            self._forcing_modes: Modes = self.mask * hats[:, :, None]

    def coordinates_and_inputs(self, t: Array) -> dict[str, Array]:
        """Return coordinates, time and measured inputs at times ``t``."""
        return {**self._coordinates, "t": t, **self._input_signals.at(t)}

    def __call__(self, modes: Modes, points: Array, t: float) -> Modes:
        """Return N in modes, given the modes of the states and their inputs on the grid."""
        values = {**self.coordinates_and_inputs(np.array(t)), **self.inputs.named(points)}
        channels = self._channel_bodies(values, (modes.shape[1], *self.inputs.shape))
        hats = to_modes(channels, self.rank)
        hats *= self.channel_symbols
        result: Modes = hats[: len(modes)]
        for equation, hat in zip(
            self.channel_equations[len(modes) :], hats[len(modes) :], strict=True
        ):
            result[equation] += hat
        for equation, field, symbol in self.couplings:
            result[equation] += symbol * modes[field]
        if len(self._knots):
            k, fraction = find_interval(self._knots, t)
            result += (1 - fraction) * self._forcing_modes[k] + fraction * self._forcing_modes[
                k + 1
            ]
        return result
