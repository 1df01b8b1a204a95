"""Algebra of expressions in normal form.

Two expressions that differ only in the order of factors or summands, or in the notation of a
number, are equal as Python objects. An expression can be a dictionary key.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from dashred.physics.expressions.functions import FUNCTIONS
from dashred.physics.expressions.nodes import (
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
    children,
    names,
    to_text,
)

__all__ = [
    "ONE",
    "ZERO",
    "Call",
    "Derivative",
    "Expr",
    "Flux",
    "Name",
    "Number",
    "Power",
    "Product",
    "Sum",
    "Where",
    "add",
    "call",
    "children",
    "derivative",
    "multiply",
    "names",
    "power",
    "scale",
    "split_coefficient",
    "substitute",
    "summands",
    "to_text",
    "where",
]

ZERO, ONE = Number(0.0), Number(1.0)


def add(terms: Iterable[Expr]) -> Expr:
    """Return the sum in normal form: flat, like terms collected, sorted.

    Raises:
        ArithmeticError: a number overflows.
    """
    coefficients: dict[Expr, float] = {}
    for term in terms:
        for summand in summands(term):
            value, rest = split_coefficient(summand)
            coefficients[rest] = coefficients.get(rest, 0.0) + value
    terms_left = [scale(value, rest) for rest, value in coefficients.items() if value != 0.0]
    if not terms_left:
        return ZERO
    if len(terms_left) == 1:
        return terms_left[0]
    return Sum(tuple(sorted(terms_left, key=_sort_key)))


def multiply(factors: Iterable[Expr]) -> Expr:
    """Return the product in normal form: flat, number first, integer powers merged, sorted.

    Raises:
        ArithmeticError: a number overflows.
    """
    value = 1.0
    exponents: dict[Expr, float] = {}
    others: list[Expr] = []
    for factor in factors:
        for f in factor.factors if isinstance(factor, Product) else (factor,):
            base, exponent = _base_and_exponent(f)
            if isinstance(f, Number):
                value *= f.value
            elif exponent is None:
                others.append(f)
            else:
                exponents[base] = exponents.get(base, 0.0) + exponent
    merged = [power(b, Number(_real(e))) for b, e in exponents.items() if e != 0.0] + others
    return scale(value, _flat_product(merged))


def power(base: Expr, exponent: Expr) -> Expr:
    """Return ``base**exponent``: constants folded, integer powers of products expanded.

    Raises:
        ArithmeticError: the constant is not a finite real number (``0**-1``, ``(-1)**0.5``).
    """
    if exponent == ZERO:
        return ONE
    if exponent == ONE:
        return base
    if isinstance(base, Number) and isinstance(exponent, Number):
        return Number(_real(base.value**exponent.value))
    if _is_integer(exponent):
        if isinstance(base, Product):
            return multiply(power(factor, exponent) for factor in base.factors)
        if isinstance(base, Power) and _is_integer(base.exponent):
            return power(base.base, multiply((base.exponent, exponent)))
    return Power(base, exponent)


def scale(value: float, expr: Expr) -> Expr:
    """Return ``value*expr`` with one number, in front.

    Raises:
        ArithmeticError: the number overflows.
    """
    inner, rest = split_coefficient(expr)
    coefficient = _real(value * inner)
    if rest == ONE or coefficient == 0.0:
        return Number(coefficient)
    if coefficient == 1.0:
        return rest
    return Product((Number(coefficient), *_factors(rest)))


def split_coefficient(expr: Expr) -> tuple[float, Expr]:
    """Split ``c*f`` into its signed number and the rest: ``-0.5*u**2`` → (-0.5, u**2)."""
    if isinstance(expr, Number):
        return expr.value, ONE
    if isinstance(expr, Product) and isinstance(expr.factors[0], Number):
        rest = expr.factors[1:]
        return expr.factors[0].value, rest[0] if len(rest) == 1 else Product(rest)
    return 1.0, expr


def summands(expr: Expr) -> tuple[Expr, ...]:
    """Return the summands of a sum, with its coefficient distributed, or the expression itself."""
    value, rest = split_coefficient(expr)
    if isinstance(rest, Sum):
        return tuple(scale(value, term) for term in rest.terms)
    return (expr,)


def call(function: str, operand: Expr) -> Expr:
    """Return ``function(operand)``; a constant if the operand is constant.

    The coefficient of an operand of a spatial operator moves to the front:
    ``grad2(2*u)`` → ``4*grad2(u)``.

    Raises:
        ArithmeticError, ValueError: the constant is not a finite real number.
    """
    if function in FUNCTIONS:
        if isinstance(operand, Number):
            return Number(_real(FUNCTIONS[function].scalar(operand.value)))
        return Call(function, operand)
    value, rest = split_coefficient(operand)
    if rest == ONE:
        return ZERO
    return scale(value * value if function == "grad2" else value, Call(function, rest))


def derivative(operand: Expr, axis: str, order: int) -> Expr:
    """Return ``∂ⁿf/∂xⁿ``: coefficient in front, nested derivatives merged and sorted by axis."""
    value, inner = split_coefficient(operand)
    if inner == ONE:
        return ZERO
    orders = {axis: order}
    while isinstance(inner, Derivative):
        orders[inner.axis] = orders.get(inner.axis, 0) + inner.order
        inner = inner.operand
    for name in sorted(orders):
        inner = Derivative(inner, name, orders[name])
    return scale(value, inner)


def where(condition: Expr, positive: Expr, otherwise: Expr) -> Expr:
    """Return ``positive`` where ``condition > 0``, else ``otherwise``, in normal form.

    A condition ``step(x)`` is written as x, and ``1 - step(x)`` as x with exchanged branches.
    """
    match condition:
        case Number(value):
            return positive if value > 0 else otherwise
        case Call("step", inner):
            return where(inner, positive, otherwise)
        case Sum((Number(1.0), Product((Number(-1.0), Call("step", inner))))):
            return where(inner, otherwise, positive)
    return positive if positive == otherwise else Where(condition, positive, otherwise)


def substitute(expr: Expr, values: Mapping[str, Expr]) -> Expr:
    """Replace names by expressions and return the normal form of the result.

    Raises:
        ArithmeticError, ValueError: a constant is not a finite real number.
    """
    match expr:
        case Name(id):
            return values.get(id, expr)
        case Sum(terms):
            return add(substitute(term, values) for term in terms)
        case Product(factors):
            return multiply(substitute(factor, values) for factor in factors)
        case Power(base, exponent):
            return power(substitute(base, values), substitute(exponent, values))
        case Call(function, operand):
            return call(function, substitute(operand, values))
        case Derivative(operand, axis, order):
            return derivative(substitute(operand, values), axis, order)
        case Flux(operand, axis, transported):
            return Flux(substitute(operand, values), axis, transported)
        case Where(condition, positive, otherwise):
            parts = (substitute(part, values) for part in (condition, positive, otherwise))
            return where(*parts)
        case Number():
            return expr


def _factors(expr: Expr) -> tuple[Expr, ...]:
    return expr.factors if isinstance(expr, Product) else (expr,)


def _base_and_exponent(expr: Expr) -> tuple[Expr, float | None]:
    if not isinstance(expr, Power):
        return expr, 1.0
    exponent = expr.exponent
    whole = isinstance(exponent, Number) and exponent.value.is_integer()
    return expr.base, exponent.value if isinstance(exponent, Number) and whole else None


def _flat_product(factors: list[Expr]) -> Expr:
    if not factors:
        return ONE
    return factors[0] if len(factors) == 1 else Product(tuple(sorted(factors, key=_sort_key)))


def _is_integer(expr: Expr) -> bool:
    return isinstance(expr, Number) and expr.value.is_integer()


def _real(value: complex) -> float:
    if isinstance(value, complex) or not math.isfinite(value):
        raise ArithmeticError("not a finite real number")
    return float(value)


_RANK = {
    Number: 0,
    Name: 1,
    Power: 2,
    Call: 3,
    Derivative: 4,
    Flux: 5,
    Where: 6,
    Product: 7,
    Sum: 8,
}


def _sort_key(expr: Expr) -> tuple[int, str]:
    return _RANK[type(expr)], to_text(expr)
