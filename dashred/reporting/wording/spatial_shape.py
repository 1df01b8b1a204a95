"""Derivatives in space in a term: of what, of which order, along which axis."""

from __future__ import annotations

from dashred.physics.expressions import algebra
from dashred.physics.expressions.algebra import Call, Derivative, Expr, Flux


def read_derivative(spatial: Expr) -> tuple[Expr, int, str] | None:
    """Return the operand, the order and the axis of a derivative; None for mixed axes.

    The axis of a Laplacian is the empty text.
    """
    order, along = 0, set[str]()
    while True:
        match spatial:
            case Derivative(operand, axis, n):
                spatial, order = operand, order + n
                along.add(axis)
            case Call("lap", operand):
                spatial, order = operand, order + 2
                along.add("")
            case _:
                return (spatial, order, along.pop()) if order and len(along) == 1 else None


def is_spatial(expr: Expr) -> bool:
    """Return whether the expression has a derivative or an integral in space."""
    if isinstance(expr, Derivative | Flux):
        return True
    if isinstance(expr, Call) and expr.function in ("lap", "inv_lap", "grad2"):
        return True
    return any(is_spatial(child) for child in algebra.children(expr))
