"""Derivatives of the equations with respect to a parameter, as expressions."""

from __future__ import annotations

from collections.abc import Collection

from dashred.physics.expressions.algebra import ZERO, Expr, substitute
from dashred.physics.expressions.differentiate import NotDifferentiableError, differentiate
from dashred.physics.system import System


def parameter_tendency(system: System, parameter: str) -> dict[str, Expr]:
    """Return ``∂N/∂p`` of every equation that depends on the parameter, with all values.

    Lets are substituted first: with ``rate: k*exp(u)``, ``∂(q*rate)/∂k`` is ``q*exp(u)``.

    Raises:
        KeyError: the system has no such parameter.
        NotDifferentiableError: see :func:`differentiate`.
        InputError: the parameters make a constant infinite.
    """
    found = {
        equation: system.ready(slope, equation, f"system.equations.{equation}")
        for equation, slope in parameter_slopes(system, parameter).items()
    }
    return {equation: slope for equation, slope in found.items() if slope != ZERO}


def parameter_slopes(system: System, parameter: str) -> dict[str, Expr]:
    """Return ``∂N/∂p`` of every equation, with lets substituted and parameters by name.

    Raises:
        KeyError: the system has no such parameter.
        NotDifferentiableError: see :func:`differentiate`.
    """
    if parameter not in system.config.parameters:
        raise KeyError(parameter)
    lets: dict[str, Expr] = {}
    for let, expr in system.lets.items():
        lets[let] = substitute(expr, lets)
    return {
        equation: differentiate(substitute(expr, lets), parameter)
        for equation, expr in system.equations.items()
    }


def acts_linearly(system: System, parameters: Collection[str]) -> bool:
    """Return whether the equations are affine in some parameters together.

    False as well if an equation has no derivative with respect to one of them.
    """
    try:
        slopes = [s for p in parameters for s in parameter_slopes(system, p).values()]
        return all(differentiate(slope, p) == ZERO for slope in slopes for p in parameters)
    except NotDifferentiableError:
        return False
