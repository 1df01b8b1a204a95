"""The names and expressions that a system declares, independent of grids and tensors."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

from dashred.core.errors import InputError
from dashred.physics import system_schema as schema
from dashred.physics.boundaries.conditions import Sides, read_conditions
from dashred.physics.boundaries.entries import one_sided_axis, with_offsets
from dashred.physics.boundaries.spatial_order import has_stencils
from dashred.physics.definitions import Definitions, check_order
from dashred.physics.expressions import algebra
from dashred.physics.expressions.algebra import Expr
from dashred.physics.expressions.lookup import Points
from dashred.physics.expressions.nodes import has_call
from dashred.physics.expressions.parser import Vocabulary, parse
from dashred.physics.expressions.reflection import Reflection
from dashred.physics.methods import METHODS
from dashred.physics.runge_kutta import Tableau

# Beginning of the column of an input that is 1 in one episode and 0 in the others.
MARK = "1 in the episode "
# Beginning of the column of an input that is the rate of a delayed input.
RATE = "rate of "


class Declaration:
    """The equations ``∂u/∂t = N(u, t)`` of every field, as expressions.

    Attributes:
        fields: names of the fields, in the order of the state's field dimension.
        lets: derived quantities that equations and sensors may read.
        equations: tendency of each field, in the user's names.
        resolved: the equations with lets and parameters substituted, so that only fields,
            coordinates and ``t`` remain, extended to the rings of axes with ends.
        has_conditions: whether the axis has a condition for each side.
        conditions: the conditions of every field, by side; empty without them.
        method: the time stepper.
        tableau: Butcher tableau of a Runge–Kutta method with fixed steps, else None.

    Raises:
        InputError: an expression is invalid or contains an unknown name, or the time stepper
            does not fit the system.
    """

    def __init__(self, config: schema.System, where: Callable[[str], str]) -> None:
        self.config, self.where = with_offsets(config, where), where
        config = self.config
        self.title, self.fields = config.title, tuple(config.fields)
        self.has_conditions = one_sided_axis(config) is not None
        is_spectral = config.integrator.space == "spectral" and not self.has_conditions
        self.spectral = bool(config.axes) and is_spectral and config.nodes is None
        self.method, self.tableau = self._method()
        self.lets: dict[str, Expr] = {}
        for name, text in config.let.items():
            expr = self.parse(text, f"system.let.{name}")
            check_order(name, expr, self.lets, config.let, where)
            self.lets[name] = expr
        # What a program computes has no expression: its equations contain what is added to it.
        own = {} if config.simulator is None else dict.fromkeys(config.fields, "0")
        self.equations = {
            field: self.parse(text, f"system.equations.{field}", equation=field)
            for field, text in {**own, **config.equations}.items()
        }
        self.conditions = self._conditions()
        self._definitions = Definitions(config.parameters, self.lets, where)
        self.resolved = {
            field: self.ready(expr, field, f"system.equations.{field}")
            for field, expr in self.equations.items()
        }
        self._check_energy()

    @cached_property
    def reflection(self) -> Reflection:
        """Extension of expressions beyond the ends of axes that are not periodic."""
        axes = self.config.axes
        mirrored = {} if self.has_conditions or self.config.nodes is not None else axes
        ends = [name for name, axis in mirrored.items() if axis.ends != "periodic"]
        odd = frozenset(name for name, axis in mirrored.items() if axis.ends == "fixed")
        return Reflection(dict.fromkeys(self.fields, odd), ends)

    @property
    def names(self) -> frozenset[str]:
        """Names that an expression may contain."""
        config = self.config
        own = (config.fields, config.parameters, config.let, config.axes)
        return frozenset().union(*own, self.clock)

    @cached_property
    def _tables(self) -> dict[str, Points]:
        tables = self.config.tables.items()
        return {name: tuple(zip(each.x, each.y, strict=True)) for name, each in tables}

    @property
    def inputs(self) -> dict[str, str]:
        """Column of each measured input in the recording, by its name in the equations."""
        return {name: given.column or name for name, given in self.config.inputs.items()}

    @property
    def measured_inputs(self) -> tuple[str, ...]:
        """Names of the inputs, without those that only mark an episode or are rates."""
        own = (MARK, RATE)
        return tuple(name for name, column in self.inputs.items() if not column.startswith(own))

    @property
    def held_inputs(self) -> frozenset[str]:
        """Columns of the inputs whose samples hold until the next one."""
        return frozenset(self.inputs[name] for name, i in self.config.inputs.items() if i.hold)

    @property
    def units(self) -> dict[str, str]:
        """Units by name in the equations, where stated; the unit of time is under ``t``."""
        return self.config.units

    @property
    def clock(self) -> frozenset[str]:
        """Names whose values are given functions of time: ``t`` and the inputs."""
        return frozenset({"t", *self.config.inputs})

    def parse(
        self, text: str, key: str, *, equation: str = "", extra: frozenset[str] = frozenset()
    ) -> Expr:
        """Parse an expression in the system's names; ``key`` is its configuration key.

        Raises:
            InputError: see :func:`dashred.physics.expressions.parser.parse`.
        """
        axes = tuple(self.config.axes)
        radial = any(axis.coordinates == "radial" for axis in self.config.axes.values())
        vocabulary = Vocabulary(self.names | extra, axes, equation, self._tables, radial)
        expr = parse(str(text), vocabulary, where=self.where(key))
        if self.has_conditions and has_call(expr, "inv_lap"):
            what = "inv_lap is not available on an axis with a condition for each side"
            raise InputError(what, where=self.where(key), hint="remove the term")
        return expr

    def without_lets(self, expr: Expr, kept: str = "") -> Expr:
        """Substitute lets in an expression, but no parameters and not the let ``kept``."""
        lets = {name: value for name, value in self.lets.items() if name != kept}
        while algebra.names(expr) & lets.keys():
            expr = algebra.substitute(expr, lets)
        return expr

    def resolve(self, expr: Expr, key: str) -> Expr:
        """Substitute lets and parameters in an expression; ``key`` is its configuration key.

        Raises:
            InputError: see :meth:`dashred.physics.definitions.Definitions.substitute_into`; or
                scattered nodes have no stencils for it.
        """
        found = self._definitions.substitute_into(expr, key)
        if self.config.nodes is not None and not has_stencils(found):
            what = "inv_lap and derivatives of more than second order are not available on nodes"
            raise InputError(what, where=self.where(key), hint="remove the term")
        return found

    def ready(self, expr: Expr, equation: str, key: str) -> Expr:
        """Resolve an expression in an equation, and extend it beyond the ends of the axes.

        Raises:
            InputError: see :meth:`resolve`.
        """
        odd = self.reflection.fields[equation]
        return self.reflection.extend(self.resolve(expr, key), odd)

    def _conditions(self) -> dict[str, Sides]:
        """Return the conditions for each side, without lets.

        Raises:
            InputError: see :func:`.boundaries.conditions.read_conditions`.
        """
        if not self.has_conditions:
            return {}
        equations = {field: self.without_lets(expr) for field, expr in self.equations.items()}

        def parsed(text: str, key: str) -> Expr:
            return self.without_lets(self.parse(text, key))

        return read_conditions(self.config, equations, parsed, self.where)

    def _method(self) -> tuple[str, Tableau | None]:
        """Return the configured or default time stepper and its tableau.

        Raises:
            InputError: the time stepper does not fit the system.
        """
        allowed = METHODS[self._space() if self.config.axes else "ode"]
        method = self.config.integrator.method or next(iter(allowed))
        if method not in allowed:
            raise InputError(
                f"integrator {method!r} does not fit this system",
                where=self.where("system.integrator.method"),
                hint=f"choose from: {', '.join(allowed)}",
            )
        tableau = allowed[method]
        return method, tableau.with_stages_inside() if tableau and self.held_inputs else tableau

    def _space(self) -> str:
        """Return the kind of the discretisation in space."""
        if self.config.nodes is not None:
            return "nodes"
        return "finite-volume" if self.has_conditions else self.config.integrator.space

    def _check_energy(self) -> None:
        text, key = self.config.energy, "system.energy"
        if text is None:
            return
        if read := self.clock & algebra.names(self.resolve(self.parse(text, key), key)):
            hint = "write it in terms of fields and parameters"
            problem = f"an energy cannot depend on {min(read)}"
            raise InputError(problem, where=self.where(key), hint=hint)
