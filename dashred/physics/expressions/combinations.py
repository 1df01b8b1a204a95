"""Functions of several numbers: ``min``, ``max``, ``clip``, ``atan2``, ``pow`` and ``where``.

They are written with the nodes of the expression tree and have none of their own. A condition is an
expression with the values 0 and 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType

from dashred.physics.expressions import algebra
from dashred.physics.expressions.algebra import ONE, ZERO, Expr, Number


def difference(a: Expr, b: Expr) -> Expr:
    """Return ``a - b``."""
    return algebra.add((a, algebra.scale(-1.0, b)))


def negation(condition: Expr) -> Expr:
    """Return 1 where a condition is 0, and 0 where it is 1."""
    return difference(ONE, condition)


def is_greater(a: Expr, b: Expr) -> Expr:
    """Return the condition ``a > b``."""
    return algebra.call("step", difference(a, b))


def _minimum(a: Expr, b: Expr) -> Expr:
    return algebra.where(difference(b, a), a, b)


def _maximum(a: Expr, b: Expr) -> Expr:
    return algebra.where(difference(a, b), a, b)


def _clip(value: Expr, low: Expr, high: Expr) -> Expr:
    return _minimum(_maximum(value, low), high)


def _atan2(y: Expr, x: Expr) -> Expr:
    """Return the angle of the point (x, y), from -π to π; 0 at the origin, as in Python."""
    if isinstance(y, Number) and isinstance(x, Number):
        # Adding 0 turns -0 into 0.
        return Number(math.atan2(y.value + 0.0, x.value + 0.0))
    straight, right = Number(math.pi), Number(math.pi / 2)
    below = algebra.scale(-1.0, y)
    half_turn = algebra.where(below, algebra.scale(-1.0, straight), straight)
    on_axis = algebra.where(y, right, algebra.where(below, algebra.scale(-1.0, right), ZERO))
    if x == ZERO:
        return on_axis
    slope = algebra.call("atan", algebra.multiply((y, algebra.power(x, Number(-1.0)))))
    left = algebra.where(algebra.scale(-1.0, x), algebra.add((slope, half_turn)), on_axis)
    return algebra.where(x, slope, left)


COMBINATIONS: Mapping[str, tuple[int, Callable[..., Expr]]] = MappingProxyType(
    {
        "min": (2, _minimum),
        "max": (2, _maximum),
        "clip": (3, _clip),
        "atan2": (2, _atan2),
        "pow": (2, algebra.power),
        "where": (3, algebra.where),
    }
)
"""Number of arguments and expression of each function, in the order of the documentation."""
