"""Smooth windows ``0 ≤ χ ≤ 1`` in space, time or the value of a field, as expressions.

A window is a ramp ``½(1 + tanh A)``, where A increases through 0 at an edge. A term in a window is
therefore an ordinary expression, and so are its derivatives with respect to edge and width.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from dashred.physics.expressions.algebra import (
    ONE,
    Expr,
    Name,
    Number,
    add,
    call,
    multiply,
    power,
    scale,
    substitute,
)
from dashred.physics.expressions.differentiate import differentiate
from dashred.physics.grids.grid import Axis
from dashred.physics.system import System

# Largest size of the log of a width in an expression: with e**50 every edge is a jump.
SHARPEST = 50.0


@dataclass(frozen=True)
class Shape:
    """A kind of window with unknown edges.

    Attributes:
        kind: ``box`` in space, ``onset`` in time, ``gate above`` or ``gate below`` a field's value.
        of: the axis, ``t``, or the field.
        names: of the unknowns, positions first, then the log of a width; they contain a space, so
            that they are not names of the equation language.
        expression: χ in terms of the unknowns, coordinates, ``t`` and fields.
        axis: the axis of a box; None of other windows.
    """

    kind: Literal["box", "onset", "gate above", "gate below"]
    of: str
    names: tuple[str, ...]
    expression: Expr
    axis: Axis | None = None

    @property
    def side(self) -> Literal["above", "below"] | None:
        """The side of the threshold on which a gate is open; None of other windows."""
        match self.kind:
            case "gate above":
                return "above"
            case "gate below":
                return "below"
        return None

    @cached_property
    def slopes(self) -> tuple[Expr, ...]:
        """Derivative ``∂χ/∂ψ`` with respect to every unknown ψ."""
        return tuple(differentiate(self.expression, name) for name in self.names)

    def at(self, values: Sequence[float]) -> Window:
        """Return the window with the given values of the unknowns."""
        return Window(self, tuple(map(float, values)))


@dataclass(frozen=True)
class Window:
    """A window with known edges.

    Attributes:
        shape: kind of the window.
        values: of the shape's unknowns.
    """

    shape: Shape
    values: tuple[float, ...]

    def __str__(self) -> str:
        """``for 10.1 < x < 16``, ``for t > 11``, ``for u > 0.6``."""
        of, place = self.shape.of, self.values[0]
        if self.shape.axis is not None:
            begin, end = self.shape.axis.interval(place - self.values[1], place + self.values[1])
            if begin > end:
                return f"for {of} > {begin:.3g} or {of} < {end:.3g}"
            return f"for {begin:.3g} < {of} < {end:.3g}"
        return f"for {of} {'<' if self.shape.side == 'below' else '>'} {place:.3g}"

    @property
    def expression(self) -> Expr:
        """χ as an expression."""
        return substitute(self.shape.expression, self._named)

    def slopes(self) -> tuple[Expr, ...]:
        """Return ``∂χ/∂ψ`` for every unknown ψ."""
        return tuple(substitute(slope, self._named) for slope in self.shape.slopes)

    @property
    def _named(self) -> dict[str, Expr]:
        *places, width = self.values
        # A fit of an edge that is sharper than any step may end far out.
        bounded = max(-SHARPEST, min(SHARPEST, width))
        named = zip(self.shape.names, (*places, bounded), strict=True)
        return {name: Number(value) for name, value in named}


def window_shapes(system: System) -> tuple[Shape, ...]:
    """Return all kinds of windows of a system."""
    value = system.reflection.value
    gates = [gate(field, side, value(field)) for field in system.fields for side in (1, -1)]
    return (*map(box, system.axes), onset(), *gates)


def box(axis: Axis) -> Shape:
    """Return a window ``|x - c| < h`` along an axis.

    ``A = (cos κ(x - c) - cos κh) / (w κ sin κh)`` with ``κ = 2π/P``, where P is the period of the
    axis' ring. A is periodic and has slope ∓1/w at ``c ± h``. Unknowns: c, h and ln w.
    """
    centre, half, edge = (f"{axis.name} {name}" for name in ("centre", "half", "edge"))
    k = 2 * math.pi / axis.period
    along = call("cos", scale(k, add((Name(axis.name), scale(-1.0, Name(centre))))))
    beyond = scale(-1.0, call("cos", scale(k, Name(half))))
    steepness = power(scale(k, call("sin", scale(k, Name(half)))), Number(-1.0))
    argument = multiply((add((along, beyond)), steepness, _inverse_width(edge)))
    return Shape("box", axis.name, (centre, half, edge), _ramp(argument), axis)


def onset() -> Shape:
    """Return a window ``t > t₀``: ``A = (t - t₀)/w``. Unknowns: t₀ and ln w."""
    begin, edge = "t begin", "t edge"
    argument = multiply((add((Name("t"), scale(-1.0, Name(begin)))), _inverse_width(edge)))
    return Shape("onset", "t", (begin, edge), _ramp(argument))


def gate(field: str, side: int, value: Expr | None = None) -> Shape:
    """Return a window ``f > θ`` or ``f < θ``: ``A = ±(f - θ)/w``. Unknowns: θ and ln w.

    Args:
        field: f.
        side: 1 for above, -1 for below.
        value: expression for the value of f; by default its name.
    """
    threshold, edge = f"{field} threshold", f"{field} edge"
    distance = scale(float(side), add((value or Name(field), scale(-1.0, Name(threshold)))))
    argument = multiply((distance, _inverse_width(edge)))
    return Shape(
        "gate above" if side > 0 else "gate below", field, (threshold, edge), _ramp(argument)
    )


def _ramp(argument: Expr) -> Expr:
    return scale(0.5, add((ONE, call("tanh", argument))))


def _inverse_width(edge: str) -> Expr:
    return call("exp", scale(-1.0, Name(edge)))
