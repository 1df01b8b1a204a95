"""Effect of a boundary condition on the tendency.

A field depends on the condition at an end through its value at the end alone. Its response E is
this value per unit of the condition, and zero elsewhere. A change δ of the condition adds
``δ N'(u)[E]`` to the tendency.
"""

from __future__ import annotations

from collections.abc import Mapping

from dashred.physics.boundaries.conditions import Sides
from dashred.physics.expressions.algebra import ZERO, Expr, Name, add, multiply, names, substitute
from dashred.physics.expressions.differentiate import differentiate

# Name of δ; it contains a space, so that it is not a name of the equation language.
CHANGE = "change of a condition"


def response_name(field: str, side: str) -> str:
    """Return the name of E. It is not a valid name of the equation language."""
    return f"{field} {side} response"


def condition_slopes(
    equations: Mapping[str, Expr], conditions: Mapping[str, Sides], parameter: str
) -> dict[str, Expr]:
    """Return the derivative of every tendency by a parameter, through the conditions alone.

    Args:
        equations: tendencies, without lets.
        conditions: of every field.
        parameter: name of the parameter.

    Raises:
        NotDifferentiableError: see :func:`.differentiate.differentiate`.
    """
    found: dict[str, list[Expr]] = {equation: [] for equation in equations}
    for field, sides in conditions.items():
        for side, condition in sides.items():
            slope = differentiate(condition.given, parameter)
            if slope == ZERO:
                continue
            response = multiply((Name(CHANGE), Name(response_name(field, side))))
            moved = {field: add((Name(field), response))}
            for equation, expr in equations.items():
                if field in names(expr):
                    changed = differentiate(substitute(expr, moved), CHANGE)
                    effect = substitute(changed, {CHANGE: ZERO})
                    found[equation].append(multiply((slope, effect)))
    return {equation: add(parts) for equation, parts in found.items()}
