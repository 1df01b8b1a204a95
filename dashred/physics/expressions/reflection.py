"""Axes with ends, by reflection: fields go on beyond an end as its mirror image.

A field on ``[0, L]`` becomes one on a ring of ``2L``, so that all that is made for periodic axes
holds: even about insulated ends (``∂f/∂x = 0``), odd about fixed ones (``f = 0``). On the ring
every expression has to be the mirror image of itself, too. So it is taken apart into ``σᵖ e``:
e even or odd by itself, and σ the side of the ring, 1 on ``[0, L]`` and -1 on the image, with
``σ² = 1``. A derivative turns even into odd, a product adds up: ``½∂(u²)/∂x`` of an odd u is odd
without a σ, and ``σ`` remains only where an equation bends the mirror, as ``∂u/∂x`` in the
equation of an even u.
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
    add,
    call,
    derivative,
    multiply,
    power,
)
from dashred.physics.expressions.functions import FUNCTIONS, Parity

Odd = frozenset[str]
"""The axes in which an expression on the ring is odd; it is even in the others."""
EVEN: Odd = frozenset()

ODD_FUNCTIONS = frozenset(f.name for f in FUNCTIONS.values() if f.parity is Parity.ODD)
EVEN_FUNCTIONS = frozenset(f.name for f in FUNCTIONS.values() if f.parity is Parity.EVEN)
OPERATORS = frozenset({"lap", "inv_lap"})
SIDE = " side"


def side(axis: str) -> str:
    """Return the name of σ: no name of the language, so that no user's can be like it."""
    return axis + SIDE


class Reflection:
    """Writes the expressions of a system on ``[0, L]`` on its ring.

    Args:
        fields: names of those that are odd in an axis, and in which.
        axes: those that have ends.
    """

    def __init__(self, fields: Mapping[str, Odd], axes: Iterable[str]) -> None:
        self.fields, self.axes = dict(fields), frozenset(axes)

    def extended(self, expr: Expr, odd: Odd) -> Expr:
        """Return an expression as it stands in an equation that is odd in some axes."""
        if not self.axes:
            return expr
        summands = expr.terms if isinstance(expr, Sum) else (expr,)
        found = (self._apart(summand) for summand in summands)
        return add(_with_side(mine ^ odd, part) for mine, part in found)

    def value(self, field: str) -> Expr:
        """Return a field's value as on ``[0, L]``, wherever on the ring."""
        return _with_side(self.fields.get(field, EVEN), Name(field))

    def _apart(self, expr: Expr) -> tuple[Odd, Expr]:
        """Return p and e of ``σᵖ e``."""
        match expr:
            case Name(id):
                return self.fields.get(id, EVEN), expr
            case Number():
                return EVEN, expr
            case Sum(terms):
                parts = [self._apart(term) for term in terms]
                if len({odd for odd, _ in parts}) == 1:
                    return parts[0][0], add(part for _, part in parts)
                return EVEN, add(_with_side(odd, part) for odd, part in parts)
            case Product(factors):
                parts = [self._apart(factor) for factor in factors]
                odd = reduce(lambda a, b: a ^ b, (odd for odd, _ in parts))
                return odd, multiply(part for _, part in parts)
            case Power(base, Number(exponent)) if exponent.is_integer():
                odd, part = self._apart(base)
                return odd if exponent % 2 else EVEN, power(part, Number(exponent))
            case Power(base, exponent):
                return EVEN, power(self._even(base), self._even(exponent))
            case Derivative(operand, axis, order):
                odd, part = self._apart(operand)
                turned = self.axes & {axis} if order % 2 else EVEN
                return odd ^ turned, derivative(part, axis, order)
            case Flux(operand, axis, transported):
                odd, part = self._apart(operand)
                return odd ^ (self.axes & {axis}), Flux(part, axis, transported)
            case Call("grad2", operand):
                return EVEN, call("grad2", self._apart(operand)[1])
            case Call(function, operand) if function in ODD_FUNCTIONS | OPERATORS:
                odd, part = self._apart(operand)
                return odd, call(function, part)
            case Call(function, operand) if function in EVEN_FUNCTIONS:
                return EVEN, call(function, self._apart(operand)[1])
            case Call(function, operand):
                return EVEN, call(function, self._even(operand))

    def _even(self, expr: Expr) -> Expr:
        return _with_side(*self._apart(expr))


def without_sides(expr: Expr) -> Expr:
    """Return an expression without its factors of sides."""
    if not isinstance(expr, Product):
        return expr
    return multiply(f for f in expr.factors if not (isinstance(f, Name) and f.id.endswith(SIDE)))


def _with_side(odd: Odd, expr: Expr) -> Expr:
    sides = (Name(side(axis)) for axis in sorted(odd))
    return multiply((*sides, expr))
