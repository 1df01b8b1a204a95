"""The order in space of an equation, and the coefficient of its diffusion."""

from __future__ import annotations

from collections.abc import Sequence

from dashred.physics.expressions.algebra import (
    Call,
    Derivative,
    Expr,
    Flux,
    Name,
    Product,
    children,
    multiply,
    names,
    power,
    split_coefficient,
    summands,
)
from dashred.physics.expressions.algebra import Number as Constant
from dashred.physics.expressions.nodes import has_call

# Highest order of a derivative on scattered nodes, in all.
STENCIL_ORDER = 2


def conditions_needed(expr: Expr, field: str, axes: Sequence[str]) -> int:
    """Return the highest order of the derivatives of a field in an expression."""
    if field not in names(expr):
        return 0
    inner = max((conditions_needed(child, field, axes) for child in children(expr)), default=0)
    match expr:
        case Derivative(_, _, order):
            return inner + order
        case Flux() | Call("grad2", _):
            return inner + 1
        case Call("lap", _):
            return inner + 2
    return inner


def has_stencils(expr: Expr) -> bool:
    """Return whether scattered nodes have stencils for all derivatives of an expression.

    They have none for the inverse Laplacian. Those of a derivative of a second derivative have an
    error that does not become smaller with more nodes.
    """
    orders = (conditions_needed(expr, name, ()) for name in names(expr))
    return max(orders, default=0) <= STENCIL_ORDER and not has_call(expr, "inv_lap")


def flux_coefficients(equation: Expr, field: str, axis: str, radial: bool) -> list[Expr]:
    """Return k of every diffusive term of a field in its equation.

    They are ``D*d(u, x, 2)`` and ``D*lap(u)`` with k = D, and ``c*d(k*d(u, x), x)``. On a radius
    the latter is ``c*d(r*k*d(u, r), r)``.

    Args:
        equation: without lets.
        field: u.
        axis: x.
        radial: whether x is a radius.
    """
    found = []
    for summand in summands(equation):
        value, rest = split_coefficient(summand)
        factors = rest.factors if isinstance(rest, Product) else (rest,)
        for factor in factors:
            others = multiply((Constant(value), *(f for f in factors if f is not factor)))
            match factor:
                case Derivative(Name(id), along, 2) if (id, along) == (field, axis):
                    found.append(others)
                case Call("lap", Name(id)) if id == field:
                    found.append(others)
                case Derivative(operand, along, 1) if along == axis:
                    found += _within(operand, field, axis, radial)
    return found


def _within(operand: Expr, field: str, axis: str, radial: bool) -> list[Expr]:
    """Return k of every ``k*d(u, x)`` in the operand of a derivative."""
    slope = Derivative(Name(field), axis, 1)
    found = []
    for summand in summands(operand):
        factors = summand.factors if isinstance(summand, Product) else (summand,)
        if slope in factors:
            others = multiply(factor for factor in factors if factor != slope)
            radius = power(Name(axis), Constant(-1.0))
            found.append(multiply((others, radius)) if radial else others)
    return found
