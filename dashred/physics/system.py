"""A simulator declared by its equations, on its grid."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from functools import cached_property, lru_cache

import numpy as np
import torch
from torch import Tensor

from dashred.physics import system_schema as schema
from dashred.physics.backends.input_signals import NO_INPUTS, Array, InputSignals
from dashred.physics.backends.torch_backend import Program
from dashred.physics.boundaries.extension import Extension
from dashred.physics.declaration import Declaration
from dashred.physics.expressions import algebra
from dashred.physics.expressions.algebra import Expr
from dashred.physics.expressions.parser import number
from dashred.physics.external import protocol
from dashred.physics.external.program import open_program
from dashred.physics.grids.grid import Axis, Grid
from dashred.physics.grids.grid_value import Value
from dashred.physics.grids.mesh import Mesh, open_mesh
from dashred.physics.grids.operators import (
    FiniteDifferences,
    NoSpace,
    Operators,
    Scattered,
    Spectral,
    Staggered,
)
from dashred.physics.grids.transforms import modes_of

CPU = torch.device("cpu")


@dataclasses.dataclass(frozen=True)
class Term:
    """One candidate term of one equation, without its coefficient: ``u**3`` in ``∂u/∂t``."""

    equation: str
    expression: Expr

    def __str__(self) -> str:
        """Return the expression in the equation language."""
        return algebra.to_text(self.expression)


class System(Declaration):
    """The equations ``∂u/∂t = N(u, t)`` of every field, on their grid.

    Attributes:
        dt: largest time step of the integrator.
        input_signals: of the recording; a simulation needs all inputs that the configuration names.
        device: where the trajectories of spectral fields and their derivatives are computed. All
            other systems are integrated on the CPU.

    A state is float64 ``(batch, field, *grid)``; for an ODE system ``(batch, field)``.

    Raises:
        InputError: as in :class:`Declaration`, or a length is not a number.
    """

    def __init__(
        self,
        config: schema.System,
        where: Callable[[str], str],
        input_signals: InputSignals = NO_INPUTS,
        device: torch.device = CPU,
    ) -> None:
        super().__init__(config, where)
        self.input_signals = input_signals
        self.device = device if self.spectral and config.simulator is None else CPU
        self.grid: Grid | Mesh = (
            Grid(tuple(_axis(n, a, where) for n, a in config.axes.items()))
            if config.nodes is None
            else open_mesh(config.nodes)
        )
        self._places: dict[torch.device, dict[str, Tensor]] = {}
        self._evaluated: dict[str, Expr] = {}
        self.dt = _number(_step(config.integrator), where("system.integrator.dt"))

    @cached_property
    def operators(self) -> Operators:
        """Spatial operators of the system's grid."""
        if isinstance(self.grid, Mesh):
            return Scattered(self.grid)
        if not self.grid.axes:
            return NoSpace()
        if self.has_conditions:
            return Staggered(self.grid)
        return Spectral(self.grid) if self.spectral else FiniteDifferences(self.grid)

    @cached_property
    def extension(self) -> Extension:
        """Fields at all points from their cells; for an axis with a condition for each side."""
        conditions = {
            field: {
                side: dataclasses.replace(
                    condition, given=self.resolve(condition.given, condition.key)
                )
                for side, condition in sides.items()
            }
            for field, sides in self.conditions.items()
        }
        return Extension(self.grid.axes[0], conditions, self.input_signals)

    @property
    def jumps(self) -> Array:
        """Times at which a held input jumps, and a step ends; none for a program.

        The steps of a program have the same length, because it may be prepared for one length.
        """
        return NO_INPUTS.jumps if self.config.simulator else self.input_signals.jumps

    @property
    def program(self) -> protocol.Program | None:
        """The program that is stepped beside the equations; None if these are all there is."""
        if self.config.simulator is None:
            return None
        return open_program(self.config, self.where, self.grid)

    def reads_time(self, *further: Expr) -> bool:
        """Return whether the system, or a further expression, depends on time or on inputs.

        A program is taken to depend on time only through its inputs.
        """
        whole = (*self.resolved.values(), *further)
        by_program = self.program is not None and bool(self.inputs)
        return by_program or any(self.clock & algebra.names(expr) for expr in whole)

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The spatial axes; none for an ODE system."""
        return self.grid.axes

    @property
    def product_grid(self) -> Grid:
        """The grid of a system that is known to have no nodes."""
        assert isinstance(self.grid, Grid)
        return self.grid

    def contains(self, place: Sequence[float]) -> bool:
        """Return whether a place, whose coordinates are on the axes, is in the domain."""
        return self.grid.contains(place)

    def refined(self) -> System:
        """Return the same system at doubled resolution in space and time; a program, in time."""
        if self.program is not None:
            return self.with_step(self.dt / 2)
        axes = {
            name: dataclasses.replace(axis, points=axis.points * 2)
            for name, axis in self.config.axes.items()
        }
        integrator = dataclasses.replace(self.config.integrator, dt=self.dt / 2)
        config = dataclasses.replace(self.config, axes=axes, integrator=integrator)
        return self.with_config(config)

    def with_step(self, dt: float) -> System:
        """Return the same system with another time step."""
        integrator = dataclasses.replace(self.config.integrator, dt=dt)
        return self.with_config(dataclasses.replace(self.config, integrator=integrator))

    def with_fixed_steps(self) -> System:
        """Return the system with ``rk4`` in place of an adaptive method, else the system."""
        if self.axes or self.tableau is not None:
            return self
        integrator = dataclasses.replace(self.config.integrator, method="rk4")
        return self.with_config(dataclasses.replace(self.config, integrator=integrator))

    def with_terms(self, terms: Sequence[tuple[Term, float]]) -> System:
        """Return the system with terms added to its equations or lets, as text.

        A term of a let may read the let itself, with its value before the change.
        """
        equations, lets = dict(self.config.equations), dict(self.config.let)
        if self.program is not None:
            equations = {**dict.fromkeys(self.fields, "0"), **equations}
        for term, coefficient in terms:
            name, expression = term.equation, term.expression
            if name in lets:
                expression = algebra.substitute(expression, {name: self.lets[name]})
            added = algebra.to_text(algebra.scale(coefficient, expression))
            changed = lets if name in lets else equations
            before = "" if changed[name] == "0" else f"{changed[name]} + "
            changed[name] = f"{before}({added})"
        return self.with_config(dataclasses.replace(self.config, equations=equations, let=lets))

    def with_config(self, config: schema.System) -> System:
        """Return a system with another declaration and the same input signals."""
        return System(config, self.where, self.input_signals, self.device)

    def with_input_signals(self, signals: InputSignals) -> System:
        """Return the same system driven by other input signals."""
        return System(self.config, self.where, signals, self.device)

    def on(self, device: torch.device) -> System:
        """Return the same system on another device."""
        return System(self.config, self.where, self.input_signals, device)

    def evaluate(self, text: str, state: Tensor, t: float | Array = 0.0) -> Tensor:
        """Evaluate an expression of the system on states ``(*batch, field, *grid)``.

        Args:
            text: the expression.
            state: the states.
            t: one time for all states, or times that broadcast to ``(*batch)``.

        Returns:
            ``(*batch, *grid)``, in the state's dtype.
        """
        batch = state.shape[: state.dim() - len(self.grid.shape) - 1]
        flat = state.reshape(-1, len(self.fields), *self.grid.shape)
        if text not in self._evaluated:
            self._evaluated[text] = self.resolve(self.parse(text, text), text)
        clock = t
        if not isinstance(t, float):
            clock = np.broadcast_to(t, batch).reshape(-1, *[1] * len(self.grid.shape)).copy()
        [value] = _compiled(self._evaluated[text])(
            self.values(flat.double(), clock), self.operators
        )
        points = torch.as_tensor(self.operators.on_grid(value), dtype=state.dtype)
        return points.expand(len(flat), *self.grid.shape).reshape(batch + self.grid.shape)

    def values(self, state: Tensor, t: float | Array) -> dict[str, Value]:
        """Return the values of all names in expressions.

        Args:
            state: ``(batch, field, *grid)``.
            t: one time for all states, or the time of each, ``(batch, *1)`` with one 1 per axis.
        """
        fields = state.unbind(1)
        if self.spectral:
            modes = modes_of(state, self.grid.shape).unbind(1)
            named = dict(zip(self.fields, map(Value, fields, modes), strict=True))
        else:
            named = dict(zip(self.fields, map(Value, fields), strict=True))
        return named | self.coordinates_and_inputs(t, state.device)

    def coordinates_and_inputs(self, t: float | Array, device: torch.device) -> dict[str, Value]:
        """Return the values of coordinates, time and inputs."""
        if device not in self._places:
            self._places[device] = {k: v.to(device) for k, v in self.grid.places.items()}
        named = {k: Value(v) for k, v in self._places[device].items()}
        if self.has_conditions:
            named |= {k: Value(v.to(device)) for k, v in self.extension.responses.items()}
        clock = {"t": t, **self.input_signals.at(t)}
        return named | {
            name: Value(torch.as_tensor(now, dtype=torch.float64, device=device))
            for name, now in clock.items()
        }


@lru_cache(maxsize=128)
def _compiled(expr: Expr) -> Program:
    """Return the program of an expression; sensors evaluate the same one at many states."""
    return Program([expr])


def _axis(name: str, axis: schema.Axis, where: Callable[[str], str]) -> Axis:
    length = _number(axis.length, where(f"system.axes.{name}.length"))
    has_sides = isinstance(axis.ends, dict) or axis.coordinates == "radial"
    ends = "staggered" if has_sides else axis.ends
    return Axis(name, length, axis.points, ends, axis.coordinates == "radial")


def _step(integrator: schema.Integrator) -> float:
    """Return the time step, or NaN if the system has no equations."""
    return math.nan if integrator.dt is None else integrator.dt


def _number(value: float | str, where: str) -> float:
    return number(value, where=where) if isinstance(value, str) else float(value)
