"""``N(u, t)`` of separated equations in Fourier modes, and the frame that its derivative shares."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from dashred.physics.algebra import Expr, add, scale
from dashred.physics.forcing import Forcing
from dashred.physics.linear import symbols
from dashred.physics.linearisation import OPERAND, Separated, separate
from dashred.physics.pointwise import Array, Pointwise
from dashred.physics.spectral import Spectral
from dashred.physics.system import System
from dashred.physics.tendency import two_thirds


def separated(system: System, forcing: Forcing | None) -> Separated:
    """Return the separated equations with the forcing of one trajectory added.

    What the equations and the forcing's terms share is computed once.

    Raises:
        NotSeparableError, ArithmeticError: see :func:`dashred.physics.linearisation.separate`.
    """
    added = {field: [expr] for field, expr in system.resolved.items()}
    if forcing is not None:
        [coefficients] = forcing.coefficients.tolist()
        for term, coefficient in zip(forcing.terms, coefficients, strict=True):
            added[term.equation].append(scale(coefficient, term.expression))
    equations = {field: add(terms) for field, terms in added.items()}
    return separate(equations, [axis.name for axis in system.axes])


class Frame:
    """The linear outside of the equations, in one precision: modes → inputs, channels → modes.

    Attributes:
        inputs: names of the inputs, in the order in which :meth:`points` returns them.
    """

    def __init__(
        self, system: System, parts: Separated, dtype: torch.dtype, device: torch.device
    ) -> None:
        assert isinstance(system.operators, Spectral)
        self.grid, self._operators = system.grid, system.operators
        self._dtype, self._device = dtype, device
        self.fields = len(system.fields)
        index = {field: i for i, field in enumerate(system.fields)}
        plain = {name: v for name, v in parts.inputs.items() if name == v.field}
        derived = {name: v for name, v in parts.inputs.items() if name not in plain}
        self.inputs = (*plain, *derived)
        self._plain = [index[v.field] for v in plain.values()]
        self._derived = [(index[v.field], self._symbol(v.operator)) for v in derived.values()]
        # None for the identity, which most of an equation stands under.
        self._outside = [
            (index[c.equation], None if c.operator == OPERAND else self._symbol(c.operator))
            for c in parts.channels
        ]
        self._couplings = [
            (index[equation], index[field], self._symbol(operator))
            for equation, couplings in parts.couplings.items()
            for field, operator in couplings.items()
        ]
        dealias = system.config.integrator.dealias
        self._mask = two_thirds(system).to(device, dtype) if dealias else None

    def points(self, modes: Tensor) -> list[Tensor]:
        """Return the inputs on the grid, ``(column, *grid)`` each.

        Args:
            modes: of the fields, ``(field, column, *modes)``.
        """
        found: list[Tensor] = []
        if self._plain:
            every = self._plain == list(range(self.fields))
            found += self.on_grid(modes if every else modes[self._plain]).unbind(0)
        if self._derived:
            applied = modes.new_empty((len(self._derived), *modes.shape[1:]))
            for out, (field, multiplier) in zip(applied, self._derived, strict=True):
                torch.mul(modes[field], multiplier, out=out)
            found += self.on_grid(applied).unbind(0)
        return found

    def tendency(self, channels: Tensor, modes: Tensor) -> Tensor:
        """Return ``Σ C_f f + Σ D_m[G_m]`` in modes, ``(field, column, *modes)``.

        Args:
            channels: G on the grid, ``(channel, column, *grid)``.
            modes: of the fields, ``(field, column, *modes)``.
        """
        hats = self.in_modes(channels)
        found = hats[: self.fields]
        for i, (equation, multiplier) in enumerate(self._outside):
            if i < self.fields:
                if multiplier is not None:
                    found[i].mul_(multiplier)
            elif multiplier is None:
                found[equation].add_(hats[i])
            else:
                found[equation].addcmul_(hats[i], multiplier)
        for equation, field, multiplier in self._couplings:
            found[equation].addcmul_(modes[field], multiplier)
        return self.kept(found)

    def kept(self, modes: Tensor) -> Tensor:
        """Return the modes that the 2/3 rule keeps: all of them unless it was asked for."""
        return modes if self._mask is None else modes * self._mask

    def on_grid(self, modes: Tensor) -> Tensor:
        """Return ``(…, *modes)`` on the grid."""
        return torch.fft.irfftn(modes, s=self.grid.shape, dim=self.grid.dims)

    def in_modes(self, points: Tensor) -> Tensor:
        """Return ``(…, *grid)`` in modes."""
        if not points.numel():
            # No column at all: the transform of nothing is an error of the FFT library.
            *first, last = points.shape
            return points.new_empty((*first, last // 2 + 1), dtype=self._dtype)
        return torch.fft.rfftn(points, dim=self.grid.dims)

    def _symbol(self, operator: Expr) -> Tensor:
        return symbols([[operator]], self._operators, self._device)[0].to(self._dtype)


class SeparatedTendency:
    """``û' = Lû + N(û, t)`` of a system with one forcing, for few states side by side.

    On the CPU: an accelerator has nothing to gain from one state.

    Attributes:
        linear: L, ``(field, 1, *modes)``.
    """

    def __init__(self, system: System, forcing: Forcing | None) -> None:
        assert isinstance(system.operators, Spectral)
        device = torch.device("cpu")
        self.system, self.operators = system, system.operators
        self.parts = separated(system, forcing)
        self.frame = Frame(system, self.parts, torch.complex128, device)
        self.linear = symbols(list(self.parts.linear.values()), self.operators, device)[:, None]
        self.bodies = Pointwise([channel.body for channel in self.parts.channels])
        self.coordinates = {k: v.numpy() for k, v in system.grid.coordinates.items()}

    def __call__(self, modes: Tensor, t: float) -> Tensor:
        """Return N in modes, ``(field, column, *modes)``."""
        channels = self.evaluated(self.bodies, modes, np.array(t))
        return self.frame.tendency(channels, modes)

    def evaluated(self, functions: Pointwise, modes: Tensor, time: Array) -> Tensor:
        """Return functions of the inputs on the grid, ``(function, column, *grid)``.

        Args:
            functions: what to evaluate.
            modes: of the fields, ``(field, column, *modes)``.
            time: one for all, or ``(column, 1, …)`` with a 1 for every axis.
        """
        points = (points.numpy() for points in self.frame.points(modes))
        inputs = dict(zip(self.frame.inputs, points, strict=True))
        shape = modes.shape[1], *self.frame.grid.shape
        return torch.from_numpy(functions({**self.coordinates, "t": time, **inputs}, shape))
