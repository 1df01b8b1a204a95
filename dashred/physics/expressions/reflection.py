"""Bounded axes by reflection: a field on ``[0, L]`` is extended to a periodic field on ``[0, 2L]``.

The extension is even about insulated ends (``∂f/∂x = 0``) and odd about fixed ends (``f = 0``), so
that the methods for periodic axes apply. Every expression of the equations must have the same
symmetry as its equation. Each expression is therefore written as ``σᵖ e``. The factor e is even or
odd. The sign σ is 1 on ``[0, L]`` and -1 on the mirror image, with ``σ² = 1``. A derivative changes
the parity, and the parity of a product is the sum of the parities of its factors. For example,
``½∂(u²)/∂x`` of an odd u is odd and needs no σ. A factor σ remains only where a term has the wrong
parity, such as ``∂u/∂x`` in the equation of an even u.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import reduce

from dashred.physics.expressions.algebra import (
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
    where,
)
from dashred.physics.expressions.functions import FUNCTIONS, Parity

Odd = frozenset[str]
"""The axes in which an extended expression is odd; it is even in the others."""
EVEN: Odd = frozenset()

ODD_FUNCTIONS = frozenset(f.name for f in FUNCTIONS.values() if f.parity is Parity.ODD)
EVEN_FUNCTIONS = frozenset(f.name for f in FUNCTIONS.values() if f.parity is Parity.EVEN)
OPERATORS = frozenset({"lap", "inv_lap"})
SIDE = " side"


def side(axis: str) -> str:
    """Return the name of σ for an axis. It is not a valid name of the equation language."""
    return axis + SIDE


class Reflection:
    """Extends the expressions of a system from ``[0, L]`` to the periodic axis ``[0, 2L]``.

    Args:
        fields: the axes in which each field is odd, by name of the field.
        axes: names of the bounded axes.
    """

    def __init__(self, fields: Mapping[str, Odd], axes: Iterable[str]) -> None:
        self.fields, self.axes = dict(fields), frozenset(axes)

    def extend(self, expr: Expr, odd: Odd) -> Expr:
        """Return the extension of an expression in an equation that is odd in some axes."""
        if not self.axes:
            return expr
        summands = expr.terms if isinstance(expr, Sum) else (expr,)
        result = (self._split_parity(summand) for summand in summands)
        return add(_with_side(parity ^ odd, part) for parity, part in result)

    def value(self, field: str) -> Expr:
        """Return the expression of a field's value on ``[0, L]``, valid on both halves."""
        return _with_side(self.fields.get(field, EVEN), Name(field))

    def _split_parity(self, expr: Expr) -> tuple[Odd, Expr]:
        """Return p and e of the form ``σᵖ e``."""
        match expr:
            case Name(id):
                return self.fields.get(id, EVEN), expr
            case Number():
                return EVEN, expr
            case Sum(terms):
                parts = [self._split_parity(term) for term in terms]
                if len({odd for odd, _ in parts}) == 1:
                    return parts[0][0], add(part for _, part in parts)
                return EVEN, add(_with_side(odd, part) for odd, part in parts)
            case Product(factors):
                parts = [self._split_parity(factor) for factor in factors]
                odd = reduce(lambda a, b: a ^ b, (odd for odd, _ in parts))
                return odd, multiply(part for _, part in parts)
            case Power(base, Number(exponent)) if exponent.is_integer():
                odd, part = self._split_parity(base)
                return odd if exponent % 2 else EVEN, power(part, Number(exponent))
            case Power(base, exponent):
                return EVEN, power(self._even(base), self._even(exponent))
            case Derivative(operand, axis, order):
                odd, part = self._split_parity(operand)
                turned = self.axes & {axis} if order % 2 else EVEN
                return odd ^ turned, derivative(part, axis, order)
            case Flux(operand, axis, transported):
                odd, part = self._split_parity(operand)
                return odd ^ (self.axes & {axis}), Flux(part, axis, transported)
            case Call("grad2", operand):
                return EVEN, call("grad2", self._split_parity(operand)[1])
            case Call(function, operand) if function in ODD_FUNCTIONS | OPERATORS:
                odd, part = self._split_parity(operand)
                return odd, call(function, part)
            case Call(function, operand) if function in EVEN_FUNCTIONS:
                return EVEN, call(function, self._split_parity(operand)[1])
            case Call(function, operand):
                return EVEN, call(function, self._even(operand))
            case Where(condition, positive, otherwise):
                chosen = where(self._even(condition), self._even(positive), self._even(otherwise))
                return EVEN, chosen

    def _even(self, expr: Expr) -> Expr:
        return _with_side(*self._split_parity(expr))


def without_sides(expr: Expr) -> Expr:
    """Return an expression without its factors σ."""
    if not isinstance(expr, Product):
        return expr
    return multiply(f for f in expr.factors if not (isinstance(f, Name) and f.id.endswith(SIDE)))


def _with_side(odd: Odd, expr: Expr) -> Expr:
    sides = (Name(side(axis)) for axis in sorted(odd))
    return multiply((*sides, expr))
