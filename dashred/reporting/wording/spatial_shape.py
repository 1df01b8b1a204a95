"""Read spatial derivatives in an expression: operand, order and axis."""

from __future__ import annotations

from dashred.physics.expressions import algebra
from dashred.physics.expressions.algebra import Call, Derivative, Expr, Flux


def read_derivative(spatial: Expr) -> tuple[Expr, int, str] | None:
    """Return operand, order and axis of a derivative, or None for a mixed or other expression.

    The axis of a Laplacian is the empty string.
    """
    order, axes = 0, set[str]()
    while True:
        match spatial:
            case Derivative(operand, axis, n):
                spatial, order = operand, order + n
                axes.add(axis)
            case Call("lap", operand):
                spatial, order = operand, order + 2
                axes.add("")
            case _:
                return (spatial, order, axes.pop()) if order and len(axes) == 1 else None


def is_spatial(expr: Expr) -> bool:
    """Return whether the expression contains a spatial operator."""
    if isinstance(expr, Derivative | Flux):
        return True
    if isinstance(expr, Call) and expr.function in ("lap", "inv_lap", "grad2"):
        return True
    return any(is_spatial(child) for child in algebra.children(expr))
