"""The right-hand side ``N(u, t)`` of a system with its forcing, as integrators want it."""

from __future__ import annotations

import torch
from torch import Tensor

from dashred.physics.backends.input_signals import Array
from dashred.physics.backends.torch_backend import Program
from dashred.physics.expressions.algebra import ZERO, names
from dashred.physics.expressions.linear import split_linear
from dashred.physics.forcing_basis import SampledForcing
from dashred.physics.grids.fourier_symbols import symbols
from dashred.physics.grids.grid_value import Value, total
from dashred.physics.grids.spectral import Spectral
from dashred.physics.grids.transforms import modes_of, points_of
from dashred.physics.solvers.dense_forcing import ForcingEvaluator, forcing_evaluator
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.system import System, Term


class GridTendency:
    """``N`` on the grid: ``(state, t)`` → ``(batch, field, *grid)``; also for ODE systems."""

    def __init__(
        self,
        system: System,
        forcing: Forcing | None = None,
        sampled_forcing: SampledForcing | None = None,
    ) -> None:
        self.system, self.operators = system, system.operators
        self.sampled_forcing = sampled_forcing
        self.program = Program(list(system.resolved.values()))
        self.forcing = None
        if forcing is not None:
            self.forcing = forcing_evaluator(forcing, system.fields, self.operators)

    def __call__(self, state: Tensor, t: float | Array) -> Tensor:
        """Return the tendency per unit time, at one time or at that of each state."""
        values = self.system.values(state, t)
        tendencies = self.program(values, self.operators)
        if self.forcing is not None:
            tendencies = _add(tendencies, self.forcing(values))
        result = [torch.as_tensor(self.operators.on_grid(value)) for value in tendencies]
        shape = (len(state), *self.system.grid.shape)
        rates = torch.stack([f.to(state).expand(shape) for f in result], dim=1)
        return rates if self.sampled_forcing is None else rates + self.sampled_forcing.at(float(t))


class SpectralTendency:
    """``û' = Lû + N(û, t)``: the linear symbol L and the rest N, in Fourier modes.

    Attributes:
        linear: L, ``(1 | batch, field, *modes)``: the linear constant-coefficient part of each
            equation in its own field, including the linear terms of the forcing.
    """

    def __init__(
        self,
        system: System,
        forcing: Forcing | None,
        device: torch.device,
        sampled_forcing: SampledForcing | None = None,
    ) -> None:
        operators = system.operators
        assert isinstance(operators, Spectral)
        self.system, self.operators, self.sampled_forcing = system, operators, sampled_forcing
        parts = [split_linear(expr, field) for field, expr in system.resolved.items()]
        self.program = Program([rest for _, rest in parts])
        self._has_rest = any(rest != ZERO for _, rest in parts)
        self.linear = symbols([linear for linear, _ in parts], operators, device)[None]
        self.forcing = None
        if forcing is not None:
            self.forcing = self._split_forcing(forcing, device)
        self.needs_coordinates = not self._names(forcing) <= set(system.fields)
        self.mask = dealias_mask(system).to(device) if system.config.integrator.dealias else None

    @property
    def is_linear(self) -> bool:
        """Whether N is zero."""
        return not self._has_rest and self.sampled_forcing is None

    def __call__(self, modes: Tensor, t: float | Array) -> Tensor:
        """Return N in modes, ``(batch, field, *modes)``, at one time or at that of each state."""
        grid = self.system.grid
        whole = points_of(modes, grid.shape)
        fields = map(Value, whole.unbind(1), modes.unbind(1))
        values = dict(zip(self.system.fields, fields, strict=True))
        if self.needs_coordinates:
            values |= self.system.coordinates_and_inputs(t, modes.device)
        tendencies = self.program(values, self.operators)
        if self.forcing is not None:
            tendencies = _add(tendencies, self.forcing(values))
        rates = self.operators.stacked_modes(tendencies, like=modes[:, 0])
        if self.sampled_forcing is not None:
            rates = rates + modes_of(self.sampled_forcing.at(float(t)), grid.shape)
        return self.dealias(rates)

    def dealias(self, modes: Tensor) -> Tensor:
        """Apply the 2/3 rule if the integrator asks for it."""
        return modes if self.mask is None else modes * self.mask

    def _names(self, forcing: Forcing | None) -> frozenset[str]:
        terms = forcing.terms if forcing is not None else ()
        return self.program.names.union(*(names(term.expression) for term in terms))

    def _split_forcing(self, forcing: Forcing, device: torch.device) -> ForcingEvaluator:
        space = (1,) * len(self.system.grid.shape)
        split = [split_linear(term.expression, term.equation) for term in forcing.terms]
        for term, column, (taken, _) in zip(
            forcing.terms, forcing.coefficients.T, split, strict=True
        ):
            if not taken or not (column.any() or column.requires_grad):
                continue
            field = self.system.fields.index(term.equation)
            [operator] = symbols([taken], self.operators, device)
            added = operator * column.reshape(-1, *space)
            one_field = torch.zeros(len(self.system.fields), dtype=torch.float64, device=device)
            one_field[field] = 1.0
            self.linear = self.linear + added[:, None] * one_field.reshape(1, -1, *space)
        nonlinear = [j for j, (_, rest) in enumerate(split) if rest != ZERO]
        rest = tuple(Term(forcing.terms[j].equation, split[j][1]) for j in nonlinear)
        remaining = Forcing(rest, forcing.coefficients[:, nonlinear])
        self._has_rest = self._has_rest or bool(remaining.coefficients.any())
        return forcing_evaluator(remaining, self.system.fields, self.operators)


def _add(left: list[Value], right: list[Value]) -> list[Value]:
    return [total([a, b]) for a, b in zip(left, right, strict=True)]


def dealias_mask(system: System) -> Tensor:
    """Return the mask of the 2/3 rule.

    It is 1 for modes below two thirds of the highest wavenumber on every axis, and 0 for others.
    """
    mask = torch.ones((), dtype=torch.float64)
    for k in system.product_grid.wavenumbers:
        limit = k.abs().max() * 2 / 3
        mask = mask * (k.abs() < limit)
    return mask
