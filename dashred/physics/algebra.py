"""Expressions as immutable trees, kept in one normal form.

Two expressions that differ only in the order of factors or summands, or in how a
number is written, are equal as Python objects, so a term can be a dictionary key.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Number:
    """A real constant."""

    value: float


@dataclass(frozen=True, slots=True)
class Name:
    """A field, parameter, let, input, coordinate or ``t``."""

    id: str


@dataclass(frozen=True, slots=True)
class Sum:
    """``a + b + …``; build with :func:`add`."""

    terms: tuple[Expr, ...]


@dataclass(frozen=True, slots=True)
class Product:
    """``a*b*…``, a number first; build with :func:`multiply`."""

    factors: tuple[Expr, ...]


@dataclass(frozen=True, slots=True)
class Power:
    """``base**exponent``; build with :func:`power`."""

    base: Expr
    exponent: Expr


@dataclass(frozen=True, slots=True)
class Call:
    """A function or spatial operator of one operand: ``exp(f)``, ``lap(f)``, ``grad2(f)``."""

    function: str
    operand: Expr


@dataclass(frozen=True, slots=True)
class Derivative:
    """``∂ⁿf/∂xⁿ``, written ``d(f, x, n)``."""

    operand: Expr
    axis: str
    order: int


@dataclass(frozen=True, slots=True)
class Flux:
    """``∂f/∂x`` in conservative upwind form for the transported field, written ``flux(f, x)``."""

    operand: Expr
    axis: str
    transported: str


Expr = Number | Name | Sum | Product | Power | Call | Derivative | Flux

ZERO, ONE = Number(0.0), Number(1.0)


def add(terms: Iterable[Expr]) -> Expr:
    """Return the sum in normal form: flat, like terms collected, sorted."""
    coefficients: dict[Expr, float] = {}
    for term in terms:
        for summand in term.terms if isinstance(term, Sum) else (term,):
            value, rest = split_coefficient(summand)
            coefficients[rest] = coefficients.get(rest, 0.0) + value
    kept = [scale(value, rest) for rest, value in coefficients.items() if value != 0.0]
    if not kept:
        return ZERO
    return kept[0] if len(kept) == 1 else Sum(tuple(sorted(kept, key=_sort_key)))


def multiply(factors: Iterable[Expr]) -> Expr:
    """Return the product in normal form: flat, number first, integer powers merged, sorted."""
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
    if value == 0.0:
        return ZERO
    merged = [power(b, Number(e)) for b, e in exponents.items() if e != 0.0] + others
    return scale(value, _flat_product(merged))


def power(base: Expr, exponent: Expr) -> Expr:
    """Return ``base**exponent`` with constants folded.

    Raises:
        ArithmeticError: the constant is not a real number (``0**-1``, ``(-1)**0.5``).
    """
    if exponent == ZERO:
        return ONE
    if exponent == ONE:
        return base
    if isinstance(base, Number) and isinstance(exponent, Number):
        return Number(_real(lambda: base.value**exponent.value))
    if isinstance(base, Power) and _is_integer(base.exponent) and _is_integer(exponent):
        return power(base.base, multiply((base.exponent, exponent)))
    return Power(base, exponent)


def scale(value: float, expr: Expr) -> Expr:
    """Return ``value*expr`` with the number outside (distributed over a sum)."""
    if isinstance(expr, Number):
        return Number(value * expr.value)
    if value == 1.0:
        return expr
    if isinstance(expr, Sum):
        return add(scale(value, term) for term in expr.terms)
    inner, rest = split_coefficient(expr)
    factors = rest.factors if isinstance(rest, Product) else (rest,)
    return Product((Number(value * inner), *factors)) if value * inner != 1.0 else rest


def split_coefficient(expr: Expr) -> tuple[float, Expr]:
    """Split ``c*f`` into its signed number and the rest: ``-0.5*u**2`` → (-0.5, u**2)."""
    if isinstance(expr, Number):
        return expr.value, ONE
    if isinstance(expr, Product) and isinstance(expr.factors[0], Number):
        rest = expr.factors[1:]
        return expr.factors[0].value, rest[0] if len(rest) == 1 else Product(rest)
    return 1.0, expr


def summands(expr: Expr) -> tuple[Expr, ...]:
    """Return the terms of a sum, or the expression itself."""
    return expr.terms if isinstance(expr, Sum) else (expr,)


def children(expr: Expr) -> tuple[Expr, ...]:
    """Return the direct operands of a node."""
    match expr:
        case Sum(terms):
            return terms
        case Product(factors):
            return factors
        case Power(base, exponent):
            return (base, exponent)
        case Call(_, operand) | Derivative(operand, _, _) | Flux(operand, _, _):
            return (operand,)
        case _:
            return ()


def names(expr: Expr) -> frozenset[str]:
    """Return every name that the expression reads."""
    if isinstance(expr, Name):
        return frozenset({expr.id})
    return frozenset().union(*(names(child) for child in children(expr)))


def substitute(expr: Expr, values: dict[str, Expr]) -> Expr:
    """Replace names by expressions and return the normal form of the result."""
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
            return Call(function, substitute(operand, values))
        case Derivative(operand, axis, order):
            return Derivative(substitute(operand, values), axis, order)
        case Flux(operand, axis, transported):
            return Flux(substitute(operand, values), axis, transported)
        case _:
            return expr


def to_text(expr: Expr) -> str:
    """Write the expression in the equation language; parsing it again gives an equal tree."""
    match expr:
        case Number(value):
            return repr(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)
        case Name(id):
            return id
        case Sum(terms):
            head, *tail = (to_text(term) for term in terms)
            return head + "".join(f" - {t[1:]}" if t.startswith("-") else f" + {t}" for t in tail)
        case Product(factors):
            return _product_text(factors)
        case Power(base, exponent):
            return f"{_atom(base)}**{_atom(exponent)}"
        case Call(function, operand):
            return f"{function}({to_text(operand)})"
        case Derivative(operand, axis, order):
            return f"d({to_text(operand)}, {axis}{f', {order}' if order > 1 else ''})"
        case Flux(operand, axis, _):
            return f"flux({to_text(operand)}, {axis})"


def _product_text(factors: tuple[Expr, ...]) -> str:
    sign, rest = ("-", factors[1:]) if factors[0] == Number(-1.0) else ("", factors)
    return sign + "*".join(
        to_text(f) if isinstance(f, Power) else _atom(f, position) for position, f in enumerate(rest)
    )


def _atom(expr: Expr, position: int = 1) -> str:
    text = to_text(expr)
    negative = isinstance(expr, Number) and expr.value < 0 and position > 0
    return f"({text})" if negative or isinstance(expr, Sum | Product | Power) else text


def _base_and_exponent(expr: Expr) -> tuple[Expr, float | None]:
    if isinstance(expr, Power):
        exponent = expr.exponent
        return expr.base, exponent.value if _is_integer(exponent) else None  # type: ignore[union-attr]
    return expr, 1.0


def _flat_product(factors: list[Expr]) -> Expr:
    if not factors:
        return ONE
    return factors[0] if len(factors) == 1 else Product(tuple(sorted(factors, key=_sort_key)))


def _is_integer(expr: Expr) -> bool:
    return isinstance(expr, Number) and expr.value.is_integer()


def _real(compute: Callable[[], float | complex]) -> float:
    value = compute()
    if isinstance(value, complex) or not math.isfinite(value):
        raise ArithmeticError("not a finite real number")
    return float(value)


_RANK = {Number: 0, Name: 1, Power: 2, Call: 3, Derivative: 4, Flux: 5, Product: 6, Sum: 7}


def _sort_key(expr: Expr) -> tuple[int, str]:
    return _RANK[type(expr)], to_text(expr)
