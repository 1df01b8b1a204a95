"""Node types of the expression tree.

Use :mod:`dashred.physics.expressions.algebra` to build trees: it returns the normal form.
"""

from __future__ import annotations

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


@dataclass(frozen=True, slots=True)
class Where:
    """``positive`` where ``condition > 0``, else ``otherwise``; build with :func:`where`."""

    condition: Expr
    positive: Expr
    otherwise: Expr


Expr = Number | Name | Sum | Product | Power | Call | Derivative | Flux | Where


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
        case Where(condition, positive, otherwise):
            return (condition, positive, otherwise)
        case _:
            return ()


def names(expr: Expr) -> frozenset[str]:
    """Return every name that the expression reads."""
    if isinstance(expr, Name):
        return frozenset({expr.id})
    return frozenset().union(*(names(child) for child in children(expr)))


def has_call(expr: Expr, function: str) -> bool:
    """Return whether the expression contains a function or spatial operator."""
    if isinstance(expr, Call) and expr.function == function:
        return True
    return any(has_call(child, function) for child in children(expr))


def has_flux(expr: Expr) -> bool:
    """Return whether the expression contains an upwind flux."""
    return isinstance(expr, Flux) or any(map(has_flux, children(expr)))


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
        case Where(condition, positive, otherwise):
            branches = f"{to_text(positive)}, {to_text(otherwise)}"
            return f"where({to_text(condition)} > 0, {branches})"


def _product_text(factors: tuple[Expr, ...]) -> str:
    sign, rest = ("-", factors[1:]) if factors[0] == Number(-1.0) else ("", factors)
    texts = (to_text(f) if isinstance(f, Power) else _atom(f, i) for i, f in enumerate(rest))
    return sign + "*".join(texts)


def _atom(expr: Expr, position: int = 1) -> str:
    text = to_text(expr)
    negative = isinstance(expr, Number) and expr.value < 0 and position > 0
    return f"({text})" if negative or isinstance(expr, Sum | Product | Power) else text
