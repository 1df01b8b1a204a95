"""Split an equation into its linear constant-coefficient part and the rest."""

from __future__ import annotations

from dashred.physics.expressions.algebra import (
    Call,
    Derivative,
    Expr,
    Name,
    Sum,
    add,
    split_coefficient,
    summands,
)


def split_linear(equation: Expr, field: str) -> tuple[list[Expr], Expr]:
    """Split ``N(u) = Lu + R(u)``: the terms of L that act on ``field`` alone, and the rest R."""
    terms = summands(equation)
    linear = [term for term in terms if is_linear(term, field)]
    return linear, add(term for term in terms if term not in linear)


def is_linear(expr: Expr, field: str) -> bool:
    """Tell whether the expression is a constant-coefficient linear operator on ``field``."""
    _, rest = split_coefficient(expr)
    match rest:
        case Name(id):
            return id == field
        case Sum(terms):
            return all(is_linear(term, field) for term in terms)
        case Derivative(operand, _, _) | Call("lap" | "inv_lap", operand):
            return is_linear(operand, field)
    return False
