"""Sums of products, and the power of a name in a product."""

from __future__ import annotations

from dashred.physics.expressions.algebra import (
    Expr,
    Name,
    Product,
    Sum,
    add,
    multiply,
    scale,
    substitute,
    summands,
)

# Powers of a name that are told apart.
LOWEST, HIGHEST = -4, 8


def expanded(term: Expr) -> Expr:
    """Return a product of sums as a sum of products."""
    parts = term.factors if isinstance(term, Product) else (term,)
    sums = [part for part in parts if isinstance(part, Sum)]
    if not sums or len(parts) == 1:
        return term
    others = [part for part in parts if part is not sums[0]]
    return add([expanded(multiply([*others, summand])) for summand in sums[0].terms])


def products(expr: Expr) -> list[Expr]:
    """Return the products whose sum an expression is."""
    return [part for term in summands(expr) for part in summands(expanded(term))]


def degree(expr: Expr, name: str) -> int | None:
    """Return d if the expression is ``name**d`` times something without this name; None if not."""
    doubled = substitute(expr, {name: scale(2.0, Name(name))})
    found = (d for d in range(LOWEST, HIGHEST + 1) if doubled == scale(2.0**d, expr))
    return next(found, None)
