"""A simulator declared by its equations: parsed, checked, and ready to be stepped."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from functools import cached_property

import torch
from torch import Tensor

from dashred import config as schema
from dashred.errors import InputError
from dashred.physics import algebra
from dashred.physics.algebra import Expr
from dashred.physics.definitions import Definitions, check_order
from dashred.physics.expression import Vocabulary, number, parse
from dashred.physics.grid import Axis, Grid
from dashred.physics.integrators import METHODS
from dashred.physics.measured import NOTHING, Array, Measured
from dashred.physics.operators import FiniteDifferences, NoSpace, Operators, Spectral
from dashred.physics.program import Program
from dashred.physics.reflection import Reflection
from dashred.physics.value import Value


@dataclasses.dataclass(frozen=True)
class Term:
    """One candidate term of one equation, coefficient aside: ``u**3`` in ``∂u/∂t``."""

    equation: str
    expression: Expr

    def __str__(self) -> str:
        """The expression in the equation language."""
        return algebra.to_text(self.expression)


class System:
    """The equations ``∂u/∂t = N(u, t)`` of every field, on their grid.

    Attributes:
        fields: names of the fields, in the order of the state's field dimension.
        lets: named expressions that equations and sensors may read.
        equations: tendency of each field, in the user's names.
        resolved: the same with lets and parameters put in, so that only fields,
            coordinates and ``t`` are left; and on the rings of axes that have ends.
        dt: largest time step of the integrator.
        measured: its inputs; a system that is run has to have all that its config names.

    A state is float64 ``(batch, field, *grid)``; for an ODE system ``(batch, field)``.

    Raises:
        InputError: an expression is not in the language or reads an unknown name.
    """

    def __init__(
        self,
        config: schema.System,
        where: Callable[[str], str],
        measured: Measured = NOTHING,
    ) -> None:
        self.config, self.where, self.measured = config, where, measured
        self.title, self.fields = config.title, tuple(config.fields)
        self.grid = Grid(tuple(_axis(n, a, where) for n, a in config.axes.items()))
        self.spectral = bool(config.axes) and config.integrator.space == "spectral"
        self.dt = _number(_step(config.integrator), where("system.integrator.dt"))
        self.method = self._method()
        self.lets: dict[str, Expr] = {}
        for name, text in config.let.items():
            expr = self.parse(text, f"system.let.{name}")
            check_order(name, expr, self.lets, config.let, where)
            self.lets[name] = expr
        self.equations = {
            field: self.parse(text, f"system.equations.{field}", equation=field)
            for field, text in config.equations.items()
        }
        self._definitions = Definitions(config.parameters, self.lets, where)
        self.resolved = {
            field: self.ready(expr, field, f"system.equations.{field}")
            for field, expr in self.equations.items()
        }
        self._check_energy()

    @cached_property
    def operators(self) -> Operators:
        """Spatial operators of the system's grid."""
        if not self.grid.axes:
            return NoSpace()
        return Spectral(self.grid) if self.spectral else FiniteDifferences(self.grid)

    @cached_property
    def reflection(self) -> Reflection:
        """How expressions go on beyond the ends of axes that have ends."""
        ends = [axis.name for axis in self.axes if not axis.periodic]
        odd = frozenset(axis.name for axis in self.axes if axis.ends == "fixed")
        return Reflection(dict.fromkeys(self.fields, odd), ends)

    @property
    def names(self) -> frozenset[str]:
        """Every name that an expression may read."""
        config = self.config
        own = (config.fields, config.parameters, config.let, config.axes)
        return frozenset().union(*own, self.clock)

    @property
    def inputs(self) -> dict[str, str]:
        """The recording's column of every measured input, by its name in the equations."""
        return self.config.inputs

    @property
    def units(self) -> dict[str, str]:
        """The unit of each name that has one, that of time as ``t``."""
        return self.config.units

    @property
    def clock(self) -> frozenset[str]:
        """The names whose values change by themselves as time goes on."""
        return frozenset({"t", *self.config.inputs})

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The spatial axes; none for an ODE system."""
        return self.grid.axes

    def refined(self) -> System:
        """Return the same system at doubled resolution in space and time."""
        axes = {
            name: dataclasses.replace(axis, points=axis.points * 2)
            for name, axis in self.config.axes.items()
        }
        integrator = dataclasses.replace(self.config.integrator, dt=self.dt / 2)
        config = dataclasses.replace(self.config, axes=axes, integrator=integrator)
        return self.declared_as(config)

    def with_step(self, dt: float) -> System:
        """Return the same system with another time step."""
        integrator = dataclasses.replace(self.config.integrator, dt=dt)
        return self.declared_as(dataclasses.replace(self.config, integrator=integrator))

    def with_terms(self, terms: Sequence[tuple[Term, float]]) -> System:
        """Return the system with terms added to its equations, as text."""
        equations = dict(self.config.equations)
        for term, coefficient in terms:
            added = algebra.to_text(algebra.scale(coefficient, term.expression))
            equations[term.equation] = f"{equations[term.equation]} + ({added})"
        return self.declared_as(dataclasses.replace(self.config, equations=equations))

    def declared_as(self, config: schema.System) -> System:
        """Return a system of another declaration, with the same inputs."""
        return System(config, self.where, self.measured)

    def parse(
        self, text: str, key: str, *, equation: str = "", extra: frozenset[str] = frozenset()
    ) -> Expr:
        """Parse an expression over the system's names; ``key`` locates it in the config.

        Raises:
            InputError: see :func:`dashred.physics.expression.parse`.
        """
        vocabulary = Vocabulary(self.names | extra, tuple(self.config.axes), equation)
        return parse(str(text), vocabulary, where=self.where(key))

    def evaluate(self, text: str, state: Tensor, t: float = 0.0) -> Tensor:
        """Evaluate an expression of the system on states ``(*batch, field, *grid)``.

        Returns:
            ``(*batch, *grid)``, in the state's dtype.
        """
        batch = state.shape[: state.dim() - len(self.grid.shape) - 1]
        flat = state.reshape(-1, len(self.fields), *self.grid.shape)
        expr = self.resolve(self.parse(text, text), text)
        [value] = Program([expr])(self.values(flat.double(), t), self.operators)
        points = torch.as_tensor(self.operators.on_grid(value), dtype=state.dtype)
        return points.expand(len(flat), *self.grid.shape).reshape(batch + self.grid.shape)

    def values(self, state: Tensor, t: float | Array) -> dict[str, Value]:
        """Return what expressions read, from a state on the grid ``(batch, field, *grid)``.

        Args:
            state: the fields.
            t: of all of them, or of each, ``(batch, *1)`` with as many 1 as there are axes.
        """
        fields = state.unbind(1)
        if self.spectral:
            modes = torch.fft.rfftn(state, dim=self.grid.dims).unbind(1)
            named = dict(zip(self.fields, map(Value, fields, modes), strict=True))
        else:
            named = dict(zip(self.fields, map(Value, fields), strict=True))
        return named | self.surroundings(t, state.device)

    def surroundings(self, t: float | Array, device: torch.device) -> dict[str, Value]:
        """Return the values of coordinates, time and inputs."""
        named = {k: Value(v.to(device)) for k, v in self.grid.places.items()}
        clock = {"t": t, **self.measured.at(t)}
        return named | {
            name: Value(torch.as_tensor(now, dtype=torch.float64, device=device))
            for name, now in clock.items()
        }

    def resolve(self, expr: Expr, key: str) -> Expr:
        """Put lets and parameters into an expression; ``key`` locates it in the config.

        Raises:
            InputError: see :meth:`dashred.physics.definitions.Definitions.put_into`.
        """
        return self._definitions.put_into(expr, key)

    def ready(self, expr: Expr, equation: str, key: str) -> Expr:
        """Resolve an expression that stands in an equation, and let it go on beyond the ends.

        Raises:
            InputError: see :meth:`resolve`.
        """
        odd = self.reflection.fields[equation]
        return self.reflection.extended(self.resolve(expr, key), odd)

    def _method(self) -> str:
        """Return the integrator: that which is named, or the first of its kind.

        Raises:
            InputError: it is of another kind.
        """
        allowed = METHODS[self.config.integrator.space if self.config.axes else "ode"]
        method = self.config.integrator.method or allowed[0]
        if method not in allowed:
            raise InputError(
                f"integrator {method!r} does not fit this system",
                where=self.where("system.integrator.method"),
                hint=f"choose from: {', '.join(allowed)}",
            )
        return method

    def _check_energy(self) -> None:
        text, key = self.config.energy, "system.energy"
        if text is None:
            return
        if read := self.clock & algebra.names(self.resolve(self.parse(text, key), key)):
            hint = "write it over fields and parameters"
            problem = f"an energy cannot read {min(read)}"
            raise InputError(problem, where=self.where(key), hint=hint)


def _axis(name: str, axis: schema.Axis, where: Callable[[str], str]) -> Axis:
    length = _number(axis.length, where(f"system.axes.{name}.length"))
    return Axis(name, length, axis.points, axis.ends)


def _step(integrator: schema.Integrator) -> float:
    """Return the time step; not a number where there are no equations to be stepped."""
    return math.nan if integrator.dt is None else integrator.dt


def _number(value: float | str, where: str) -> float:
    return number(value, where=where) if isinstance(value, str) else float(value)
