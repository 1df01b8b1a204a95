"""Lookup in a table: ``interp(x, NAME)``, a piecewise linear function.

It is written with the nodes of the expression tree and has none of its own. With the slopes s_k
between the points (x_k, y_k), and slope 0 outside of them::

    y(x) = (y_1 + y_n)/2 + Σ_k (s_k - s_{k-1})/2 · |x - x_k|
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from dashred.physics.expressions import algebra
from dashred.physics.expressions.algebra import Expr, Number

Points = tuple[tuple[float, float], ...]


def interpolate(value: Expr, points: Sequence[tuple[float, float]]) -> Expr:
    """Return the table's value, linear between points and constant outside of them.

    Args:
        value: where the table is looked up.
        points: x and y of each point, with increasing x.
    """
    slopes = [(y1 - y0) / (x1 - x0) for (x0, y0), (x1, y1) in pairwise(points)]
    terms: list[Expr] = [Number((points[0][1] + points[-1][1]) / 2)]
    for (x, _), (before, after) in zip(points, pairwise([0.0, *slopes, 0.0]), strict=True):
        distance = algebra.call("abs", algebra.add((value, Number(-x))))
        terms.append(algebra.scale((after - before) / 2, distance))
    return algebra.add(terms)
