"""``N(u, t)`` of separated equations in Fourier modes, at few states side by side, in NumPy.

A few hundred points are so little that an operation costs what its call costs: NumPy's calls
cost a fifth of torch's, and one FFT serves all inputs, one all channels.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from dashred.physics.backends.numpy_backend import Array, Pointwise
from dashred.physics.expressions.algebra import Expr, add, scale
from dashred.physics.expressions.semilinear import Input, SemilinearForm, semilinear_form
from dashred.physics.forcing_basis import SampledForcing
from dashred.physics.grids.fourier_symbols import symbols
from dashred.physics.grids.spectral import Spectral
from dashred.physics.grids.transforms import from_modes, to_modes
from dashred.physics.solvers.compiled_step import find_interval
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.rhs import dealias_mask
from dashred.physics.system import System

Modes = NDArray[Any]
"""Of the fields, ``(field, state, *modes)``, if nothing else is said."""


def forced_semilinear_form(system: System, forcing: Forcing | None) -> SemilinearForm:
    """Return the separated equations with the forcing of one trajectory added.

    What the equations and the forcing's terms share is computed once.

    Raises:
        NotSeparableError, ArithmeticError: as of :func:`semilinear.separate`.
    """
    added = {field: [expr] for field, expr in system.resolved.items()}
    if forcing is not None:
        [coefficients] = forcing.coefficients.tolist()
        for term, coefficient in zip(forcing.terms, coefficients, strict=True):
            added[term.equation].append(scale(coefficient, term.expression))
    equations = {field: add(terms) for field, terms in added.items()}
    return semilinear_form(equations, [axis.name for axis in system.axes])


def operator_symbol(system: System, operator: Expr) -> Modes:
    """Return the Fourier symbol of an operator on one field, ``(*modes)``."""
    assert isinstance(system.operators, Spectral)
    found: Modes = symbols([[operator]], system.operators, torch.device("cpu"))[0].numpy()
    return found


def mode_mask(system: System) -> Modes:
    """Return 1 for the modes that the 2/3 rule keeps, ``(*modes)``: all unless it was asked for."""
    *first, last = system.grid.shape
    if system.config.integrator.dealias:
        return dealias_mask(system).numpy()
    return np.ones((*first, last // 2 + 1))


class Inputs:
    """What pointwise functions read: ``v = V f`` on the grid.

    Attributes:
        fields: the field of every input.
        multipliers: V, ``(input, 1, *modes)``.
    """

    def __init__(self, system: System, inputs: Mapping[str, Input]) -> None:
        self.names, self.shape = tuple(inputs), system.grid.shape
        self.fields = np.array([system.fields.index(v.field) for v in inputs.values()], dtype=int)
        found = [operator_symbol(system, v.operator)[None] for v in inputs.values()]
        self.multipliers = np.array(found)

    def __call__(self, modes: Modes) -> Array:
        """Return the inputs, ``(input, state, *grid)``."""
        if not self.names:
            return np.empty((0, modes.shape[1], *self.shape))
        return from_modes(modes[self.fields] * self.multipliers, self.shape)

    def named(self, points: Array) -> dict[str, Array]:
        """Return the inputs by their names."""
        return dict(zip(self.names, points, strict=True))


class SemilinearTendency:
    """``û' = Lû + N(û, t)`` of a system with one forcing and one drive.

    Attributes:
        parts: the equations taken apart.
        linear: L, ``(field, 1, *modes)``.
        outside: D, ``(channel, 1, *modes)``; the modes dropped by the 2/3 rule are zero.
        places: the equation of every channel.
        couplings: ``(equation, field, C)``, likewise.
    """

    def __init__(
        self, system: System, forcing: Forcing | None, sampled_forcing: SampledForcing | None = None
    ) -> None:
        assert isinstance(system.operators, Spectral)
        self.form = forced_semilinear_form(system, forcing)
        index = {field: i for i, field in enumerate(system.fields)}
        linear = list(self.form.linear.values())
        self.linear = symbols(linear, system.operators, torch.device("cpu"))[:, None]
        self.inputs = Inputs(system, self.form.inputs)
        self.rank, self.mask = len(system.grid.shape), mode_mask(system)
        outside = [self.mask * operator_symbol(system, c.operator) for c in self.form.channels]
        self.outside = np.array(outside)[:, None]
        self.places = [index[channel.equation] for channel in self.form.channels]
        self.couplings = [
            (index[equation], index[field], self.mask * operator_symbol(system, operator))
            for equation, couplings in self.form.couplings.items()
            for field, operator in couplings.items()
        ]
        self._bodies = Pointwise([channel.body for channel in self.form.channels])
        self._coordinates = {k: v.numpy() for k, v in system.grid.places.items()}
        self._input_signals = system.input_signals
        self._knots: Array = (
            np.zeros(0) if sampled_forcing is None else sampled_forcing.knots.numpy()
        )
        if sampled_forcing is not None:
            hats = to_modes(sampled_forcing.values[0].numpy(), self.rank)
            self._drive: Modes = self.mask * hats[:, :, None]

    def coordinates_and_inputs(self, t: Array) -> dict[str, Array]:
        """Return coordinates, time and measured inputs, at some times."""
        return {**self._coordinates, "t": t, **self._input_signals.at(t)}

    def __call__(self, modes: Modes, points: Array, t: float) -> Modes:
        """Return N of states in modes; ``points`` are their inputs."""
        values = {**self.coordinates_and_inputs(np.array(t)), **self.inputs.named(points)}
        channels = self._bodies(values, (modes.shape[1], *self.inputs.shape))
        hats = to_modes(channels, self.rank)
        hats *= self.outside
        found: Modes = hats[: len(modes)]
        for place, hat in zip(self.places[len(modes) :], hats[len(modes) :], strict=True):
            found[place] += hat
        for equation, field, symbol in self.couplings:
            found[equation] += symbol * modes[field]
        if len(self._knots):
            k, share = find_interval(self._knots, t)
            found += (1 - share) * self._drive[k] + share * self._drive[k + 1]
        return found
