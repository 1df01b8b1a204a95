"""Symbolic partial derivatives of expressions, in normal form."""

from __future__ import annotations

from functools import cache

from dashred.physics.expressions.algebra import (
    ONE,
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
    derivative,
    multiply,
    power,
    scale,
    substitute,
    where,
)
from dashred.physics.expressions.functions import FUNCTIONS
from dashred.physics.expressions.parser import Vocabulary, parse

ARGUMENT = "x"
"""Name of the argument in the derivatives of :data:`FUNCTIONS`."""


class NotDifferentiableError(Exception):
    """The derivative cannot be written in the equation language."""


def differentiate(expr: Expr, name: str) -> Expr:
    """Return ``∂expr/∂name``.

    The derivative commutes with spatial operators, as for a parameter that is constant in space:
    ``∂/∂c lap(c*u) = lap(u)``. The derivatives of ``sign`` and ``step`` are zero,
    and the jumps of ``where`` are left out.

    Raises:
        NotDifferentiableError: the name is the field that a flux transports.
        ArithmeticError: a constant is not a finite real number.
    """
    match expr:
        case Name(id):
            return ONE if id == name else ZERO
        case Sum(terms):
            return add(differentiate(term, name) for term in terms)
        case Product(factors):
            return _product_rule(factors, name)
        case Power(base, exponent):
            return _power_rule(base, exponent, name)
        case Call("lap" | "inv_lap" as operator, operand):
            return call(operator, differentiate(operand, name))
        case Call("grad2", operand):
            return _squared_gradient_rule(operand, differentiate(operand, name))
        case Call(function, operand):
            return multiply((_outer_derivative(function, operand), differentiate(operand, name)))
        case Derivative(operand, axis, order):
            return derivative(differentiate(operand, name), axis, order)
        case Flux(operand, axis, transported):
            if name == transported:
                raise NotDifferentiableError(
                    f"a flux depends on {name!r} through its upwind side too"
                )
            slope = differentiate(operand, name)
            return slope if slope == ZERO else Flux(slope, axis, transported)
        case Where(condition, positive, otherwise):
            return where(condition, differentiate(positive, name), differentiate(otherwise, name))
        case Number():
            return ZERO


def _product_rule(factors: tuple[Expr, ...], name: str) -> Expr:
    slopes = ((i, differentiate(factor, name)) for i, factor in enumerate(factors))
    return add(multiply((*factors[:i], s, *factors[i + 1 :])) for i, s in slopes if s != ZERO)


def _power_rule(base: Expr, exponent: Expr, name: str) -> Expr:
    of_base, of_exponent = differentiate(base, name), differentiate(exponent, name)
    result = []
    # For a constant exponent, log(base) must not appear: the base may be negative.
    if of_base != ZERO:
        lowered = power(base, add((exponent, Number(-1.0))))
        result.append(multiply((exponent, lowered, of_base)))
    if of_exponent != ZERO:
        result.append(multiply((power(base, exponent), call("log", base), of_exponent)))
    return add(result)


def _outer_derivative(function: str, operand: Expr) -> Expr:
    """Return ``f'(operand)``."""
    return substitute(_table_derivative(function), {ARGUMENT: operand})


@cache
def _table_derivative(function: str) -> Expr:
    text = FUNCTIONS[function].derivative
    return parse(text, Vocabulary(frozenset({ARGUMENT})), where=f"derivative of {function}")


def _squared_gradient_rule(operand: Expr, slope: Expr) -> Expr:
    """Return ``2∇f·∇g`` by polarisation: the language has no product of gradients."""
    ahead, behind = add((operand, slope)), add((operand, scale(-1.0, slope)))
    halves = (scale(0.5, call("grad2", ahead)), scale(-0.5, call("grad2", behind)))
    return ZERO if slope == ZERO else add(halves)
