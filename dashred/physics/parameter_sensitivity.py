"""Derivatives of the equations and readings with respect to a parameter, as expressions."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence, Set

from dashred.physics.boundaries.responses import condition_slopes
from dashred.physics.expressions.algebra import ZERO, Call, Expr, Where, add, children, names
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

    It includes the effect through conditions at the ends of the axis.

    Raises:
        KeyError: the system has no such parameter.
        NotDifferentiableError: see :func:`differentiate`.
    """
    if parameter not in system.config.parameters:
        raise KeyError(parameter)
    equations = {name: system.without_lets(expr) for name, expr in system.equations.items()}
    by_conditions = condition_slopes(equations, system.conditions, parameter)
    return {
        equation: add((differentiate(expr, parameter), by_conditions[equation]))
        for equation, expr in equations.items()
    }


def reading_slopes(system: System, reads: Sequence[str]) -> dict[str, Expr]:
    """Return ``∂h/∂p`` of a reading ``h = Σ reads`` for every parameter that it depends on.

    Parameters remain by name.

    Raises:
        NotDifferentiableError: see :func:`differentiate`.
    """
    whole = add([_reading(system, name) for name in reads])
    known = sorted(names(whole) & system.config.parameters.keys())
    slopes = {parameter: differentiate(whole, parameter) for parameter in known}
    return {parameter: slope for parameter, slope in slopes.items() if slope != ZERO}


def parameters_read(system: System, reads: Iterable[Sequence[str]]) -> frozenset[str]:
    """Return the parameters that some readings depend on; see :func:`reading_slopes`."""
    return frozenset().union(*(reading_slopes(system, each) for each in reads))


def acts_linearly(system: System, parameters: Collection[str], reads: Collection[str] = ()) -> bool:
    """Return whether the equations are affine in some parameters together.

    False as well if an equation has no derivative with respect to one of them, or contains one
    within a function: the derivative does not tell where a ``clip`` or a ``step`` jumps.

    Args:
        system: the simulator.
        parameters: their names.
        reads: fields and lets that have to be affine in them, too.
    """
    whole = [*map(system.without_lets, system.equations.values())]
    whole += [_reading(system, name) for name in reads]
    if any(is_within_function(expr, set(parameters)) for expr in whole):
        return False
    try:
        slopes = [differentiate(expr, p) for p in parameters for expr in whole]
        return all(differentiate(slope, p) == ZERO for slope in slopes for p in parameters)
    except NotDifferentiableError:
        return False


def act_separately(system: System, parameters: Collection[str]) -> bool:
    """Return whether the effect of each parameter does not depend on the values of the others.

    False as well if an equation has no derivative with respect to one of them.
    """
    try:
        return all(
            differentiate(slope, q) == ZERO
            for p in parameters
            for slope in parameter_slopes(system, p).values()
            for q in parameters
            if q != p
        )
    except NotDifferentiableError:
        return False


def _reading(system: System, name: str) -> Expr:
    return system.without_lets(system.parse(name, f"system.let.{name}"))


def is_within_function(expr: Expr, parameters: Set[str]) -> bool:
    """Return whether an argument of a function or a condition contains one of some names."""
    if isinstance(expr, Call | Where) and names(expr) & parameters:
        return True
    return any(is_within_function(child, parameters) for child in children(expr))
