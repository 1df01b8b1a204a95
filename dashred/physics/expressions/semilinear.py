"""Equations taken apart so that their derivative is cheap: pointwise inside, linear outside.

Every equation is written as ``∂u/∂t = Lu + Σ_f C_f f + Σ_m D_m[G_m(v)]``: L and C_f are
constant-coefficient operators on one field, the D_m too, and the G_m are pointwise functions of
inputs ``v = V f``, each a constant-coefficient operator on one field. Then
``δN = Lδu + Σ C_f δf + Σ_m D_m[Σ_i ∂G_m/∂v_i · V_i δf_i]``: a library of pointwise terms only
changes the functions ∂G_m/∂v_i, never the number of transforms.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from dashred.physics.expressions.algebra import (
    ZERO,
    Call,
    Derivative,
    Expr,
    Flux,
    Name,
    Number,
    Power,
    Product,
    Sum,
    add,
    call,
    multiply,
    names,
    power,
    scale,
    split_coefficient,
    summands,
    to_text,
)
from dashred.physics.expressions.differentiate import differentiate
from dashred.physics.expressions.linear import split_linear

OPERAND = Name("·")
"""Stands for what an operator acts on: no name of the language looks like it."""


class NotSemilinearError(Exception):
    """A spatial operator acts on a product inside a product: ``u*lap(u**2)``."""


@dataclass(frozen=True)
class Channel:
    """One ``D[G(v)]`` of an equation.

    Attributes:
        equation: the field whose tendency it is part of.
        operator: D, an expression of :data:`OPERAND`.
        body: G, reading inputs, coordinates and ``t``.
    """

    equation: str
    operator: Expr
    body: Expr


@dataclass(frozen=True)
class Input:
    """``v = V f``: the field f, and V as an expression of :data:`OPERAND`."""

    field: str
    operator: Expr


@dataclass(frozen=True)
class SemilinearForm:
    """The parts of all equations, by field; see the module.

    Attributes:
        linear: L's terms, treated exactly by the integrator.
        couplings: ``C_f`` by f, expressions of :data:`OPERAND`.
        channels: the first of every equation, in the order of the fields, then the others.
        inputs: by the name that bodies read; a field itself by its own.
    """

    linear: dict[str, list[Expr]]
    couplings: dict[str, dict[str, Expr]]
    channels: tuple[Channel, ...]
    inputs: dict[str, Input]

    def slopes(self, channel: Channel) -> dict[str, Expr]:
        """Return ``∂G/∂v`` by the input's name, zeros left out.

        Raises:
            ArithmeticError: a constant in a derivative is not a finite real number.
        """
        read = names(channel.body)
        slopes = {name: differentiate(channel.body, name) for name in self.inputs if name in read}
        return {name: slope for name, slope in slopes.items() if slope != ZERO}


def semilinear_form(equations: Mapping[str, Expr], axes: Sequence[str]) -> SemilinearForm:
    """Take equations apart.

    Args:
        equations: tendency of each field, lets and parameters put in.
        axes: names of the spatial axes.

    Raises:
        NotSeparableError: an equation does not have the form.
        ArithmeticError: a constant is not a finite real number.
    """
    separator = SemilinearBuilder(frozenset(equations), tuple(axes))
    split = {field: split_linear(expr, field) for field, expr in equations.items()}
    parts = {field: separator.equation(field, rest) for field, (_, rest) in split.items()}
    channels = [found for _, found in parts.values()]
    return SemilinearForm(
        linear={field: linear for field, (linear, _) in split.items()},
        couplings={field: couplings for field, (couplings, _) in parts.items()},
        channels=(*(first for first, *_ in channels), *(c for _, *rest in channels for c in rest)),
        inputs=separator.inputs,
    )


class SemilinearBuilder:
    """Collects the inputs of all equations as it takes them apart.

    Attributes:
        inputs: by the name that bodies read.
    """

    def __init__(self, fields: frozenset[str], axes: tuple[str, ...]) -> None:
        self.fields, self.axes = fields, axes
        self.inputs: dict[str, Input] = {}

    def equation(self, field: str, rest: Expr) -> tuple[dict[str, Expr], list[Channel]]:
        """Return the couplings and channels of an equation without its linear part."""
        couplings: dict[str, list[Expr]] = {}
        bodies: dict[Expr, list[Expr]] = {}
        for operator, body in self.split_operators(rest):
            value, inner = split_coefficient(body)
            if isinstance(inner, Name) and inner.id in self.fields:
                couplings.setdefault(inner.id, []).append(scale(value, operator))
            else:
                bodies.setdefault(operator, []).append(self.pointwise(body))
        added = {name: add(operators) for name, operators in couplings.items()}
        summed = {operator: add(parts) for operator, parts in bodies.items()} or {OPERAND: ZERO}
        return added, [Channel(field, operator, body) for operator, body in summed.items()]

    def split_operators(self, expr: Expr) -> Iterator[tuple[Expr, Expr]]:
        """Yield ``(D, G)`` with ``Σ D[G]`` the expression, operators taken outside of sums."""
        for summand in summands(expr):
            value, rest = split_coefficient(summand)
            match rest:
                case Derivative(operand, axis, order):
                    outer: Expr = Derivative(OPERAND, axis, order)
                case Flux(operand, axis, _):
                    outer = Derivative(OPERAND, axis, 1)
                case Call("lap" | "inv_lap" as operator, operand):
                    outer = Call(operator, OPERAND)
                case _:
                    yield OPERAND, summand
                    continue
            for inner, body in self.split_operators(operand):
                yield apply_operator(outer, inner), scale(value, body)

    def pointwise(self, expr: Expr) -> Expr:
        """Return the expression with an input's name for every linear operator in it."""
        match expr:
            case Name(id) if id in self.fields:
                return self.input(id, OPERAND)
            case Sum(terms):
                return add(map(self.pointwise, terms))
            case Product(factors):
                return multiply(map(self.pointwise, factors))
            case Power(base, exponent):
                return power(self.pointwise(base), self.pointwise(exponent))
            case Call("grad2", operand):
                slopes = (Derivative(operand, axis, 1) for axis in self.axes)
                return add(power(self.pointwise(slope), Number(2.0)) for slope in slopes)
            case Derivative() | Flux() | Call("lap" | "inv_lap", _):
                return add(map(self.linear_input, self.split_operators(expr)))
            case Call(function, operand):
                return call(function, self.pointwise(operand))
            case Number() | Name():
                return expr

    def linear_input(self, part: tuple[Expr, Expr]) -> Expr:
        """Return the name of ``D[f]`` times its number."""
        operator, body = part
        value, inner = split_coefficient(body)
        if not isinstance(inner, Name) or inner.id not in self.fields:
            raise NotSemilinearError(to_text(apply_operator(operator, body)))
        return scale(value, self.input(inner.id, operator))

    def input(self, field: str, operator: Expr) -> Name:
        """Return the name under which bodies read ``V f``."""
        name = to_text(apply_operator(operator, Name(field)))
        self.inputs[name] = Input(field, operator)
        return Name(name)


def apply_operator(operator: Expr, operand: Expr) -> Expr:
    """Return an operator of :data:`OPERAND` on an operand."""
    # Not in normal form: merging derivatives would change what becomes of the Nyquist mode.
    match operator:
        case Derivative(inner, axis, order):
            return Derivative(apply_operator(inner, operand), axis, order)
        case Call(function, inner):
            return Call(function, apply_operator(inner, operand))
    return operand
