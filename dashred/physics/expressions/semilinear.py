"""Semilinear form of equations: linear operators applied to pointwise functions.

Every equation is written as ``∂u/∂t = Lu + Σ_f C_f f + Σ_m D_m[G_m(v)]``. L, C_f and D_m are
constant-coefficient linear operators. The G_m are pointwise functions of inputs ``v = V f``, where
V is a constant-coefficient linear operator on one field. The derivative is then
``δN = Lδu + Σ C_f δf + Σ_m D_m[Σ_i ∂G_m/∂v_i · V_i δf_i]``. Pointwise library terms change the
functions ∂G_m/∂v_i only, not the number of Fourier transforms.
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
    Where,
    add,
    call,
    multiply,
    names,
    power,
    scale,
    split_coefficient,
    summands,
    to_text,
    where,
)
from dashred.physics.expressions.differentiate import differentiate
from dashred.physics.expressions.linear import split_linear

OPERAND = Name("·")
"""Placeholder for the operand of an operator; it is not a valid name of the equation language."""


class NotSemilinearError(Exception):
    """An equation has no semilinear form, for example ``u*lap(u**2)``."""


@dataclass(frozen=True)
class Channel:
    """One ``D[G(v)]`` of an equation.

    Attributes:
        equation: the field whose tendency it contributes to.
        operator: D, an expression of :data:`OPERAND`.
        body: G, a function of inputs, coordinates and ``t``.
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
    """Semilinear form of a system of equations; see the module.

    Attributes:
        linear: terms of L by equation; the integrator treats them exactly.
        couplings: ``C_f`` by equation and field f, expressions of :data:`OPERAND`.
        channels: the first channel of each equation, in the order of the fields, then the others.
        inputs: inputs by name; the input of a field itself has the name of the field.
    """

    linear: dict[str, list[Expr]]
    couplings: dict[str, dict[str, Expr]]
    channels: tuple[Channel, ...]
    inputs: dict[str, Input]

    def slopes(self, channel: Channel) -> dict[str, Expr]:
        """Return the nonzero ``∂G/∂v`` by name of the input.

        Raises:
            ArithmeticError: a constant in a derivative is not a finite real number.
        """
        read = names(channel.body)
        slopes = {name: differentiate(channel.body, name) for name in self.inputs if name in read}
        return {name: slope for name, slope in slopes.items() if slope != ZERO}


def semilinear_form(equations: Mapping[str, Expr], axes: Sequence[str]) -> SemilinearForm:
    """Return the semilinear form of equations.

    Args:
        equations: tendency of each field, with lets and parameters substituted.
        axes: names of the spatial axes.

    Raises:
        NotSemilinearError: an equation has no semilinear form.
        ArithmeticError: a constant is not a finite real number.
    """
    builder = SemilinearBuilder(frozenset(equations), tuple(axes))
    split = {field: split_linear(expr, field) for field, expr in equations.items()}
    parts = {field: builder.equation(field, rest) for field, (_, rest) in split.items()}
    channels = [result for _, result in parts.values()]
    return SemilinearForm(
        linear={field: linear for field, (linear, _) in split.items()},
        couplings={field: couplings for field, (couplings, _) in parts.items()},
        channels=(*(first for first, *_ in channels), *(c for _, *rest in channels for c in rest)),
        inputs=builder.inputs,
    )


class SemilinearBuilder:
    """Builds the semilinear form and collects the inputs of all equations.

    Attributes:
        inputs: inputs by name.
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
        """Yield ``(D, G)`` with ``Σ D[G]`` the expression, with operators distributed over sums."""
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
        """Return the expression with each linear operator on a field replaced by an input."""
        match expr:
            case Name(id) if id in self.fields:
                return self.add_input(id, OPERAND)
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
            case Where(condition, positive, otherwise):
                return where(*map(self.pointwise, (condition, positive, otherwise)))
            case Number() | Name():
                return expr

    def linear_input(self, part: tuple[Expr, Expr]) -> Expr:
        """Return the input ``D[f]`` times its coefficient."""
        operator, body = part
        value, inner = split_coefficient(body)
        if not isinstance(inner, Name) or inner.id not in self.fields:
            raise NotSemilinearError(to_text(apply_operator(operator, body)))
        return scale(value, self.add_input(inner.id, operator))

    def add_input(self, field: str, operator: Expr) -> Name:
        """Register the input ``V f`` and return its name."""
        name = to_text(apply_operator(operator, Name(field)))
        self.inputs[name] = Input(field, operator)
        return Name(name)


def apply_operator(operator: Expr, operand: Expr) -> Expr:
    """Apply an operator, given as an expression of :data:`OPERAND`, to an operand."""
    # The result is not in normal form: merged derivatives treat the Nyquist mode differently.
    match operator:
        case Derivative(inner, axis, order):
            return Derivative(apply_operator(inner, operand), axis, order)
        case Call(function, inner):
            return Call(function, apply_operator(inner, operand))
    return operand
