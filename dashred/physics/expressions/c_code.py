"""C source code of pointwise expressions."""

from __future__ import annotations

from collections.abc import Mapping

from dashred.physics.expressions.algebra import (
    Call,
    Expr,
    Name,
    Number,
    Power,
    Product,
    Sum,
    Where,
)
from dashred.physics.expressions.functions import FUNCTIONS

# The other functions have the same name in <math.h>, or are in DEFINITIONS.
_NAMES = {"abs": "fabs"}
DEFINITIONS = """\
static double sech(double x) { return 1.0 / cosh(x); }
static double sign(double x) { return (x > 0.0) - (x < 0.0); }
static double step(double x) { return x > 0.0; }
"""
"""Functions that ``<math.h>`` does not have; the code of an expression may use them."""


def c_code(expr: Expr, known: Mapping[str, str]) -> str:
    """Return the C expression of a value, a double, with all parentheses.

    Args:
        expr: the expression.
        known: C expression of each name.

    Raises:
        TypeError: the expression is not pointwise.
    """

    def joined(operator: str, operands: tuple[Expr, ...]) -> str:
        return f"({operator.join(c_code(operand, known) for operand in operands)})"

    match expr:
        case Number(value):
            return f"({value!r})"
        case Name(id):
            return known[id]
        case Sum(terms):
            return joined(" + ", terms)
        case Product(factors):
            return joined(" * ", factors)
        case Power(base, exponent):
            return f"pow({c_code(base, known)}, {c_code(exponent, known)})"
        case Call(function, operand) if function in FUNCTIONS:
            return f"{_NAMES.get(function, function)}({c_code(operand, known)})"
        case Where(condition, positive, otherwise):
            test = f"{c_code(condition, known)} > 0.0"
            return f"({test} ? {c_code(positive, known)} : {c_code(otherwise, known)})"
    raise TypeError(f"{expr!r} is not pointwise")
