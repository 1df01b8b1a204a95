"""Units of coefficients, derived from the units of the names in a term."""

from __future__ import annotations

from fractions import Fraction

from dashred.core.units import ONE, TIME, Unit, parse_unit
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
)
from dashred.physics.expressions.functions import FUNCTIONS
from dashred.physics.system import System

# Prefix of a name whose unit is not stated; a user's unit cannot begin with it.
UNKNOWN = "\0"


def coefficient_unit(system: System, equation: str, term: Expr) -> str | None:
    """Return the unit of ξ in ``df/dt = … + ξ·term``: ``[ξ] = [f]/([t][term])``.

    In a let m the unit is ``[m]/[term]``.

    Unknown units may cancel: for a linear damping only the unit of time is needed. The result is
    None if an unknown unit remains, if different units are added, or if the system states no
    units.

    Args:
        system: with units by name.
        equation: f, or the let m.
        term: the term, without its coefficient.
    """
    whole = unit_of(system, term)
    if not system.units or whole is None:
        return None
    found = _of_name(system, equation) / whole
    if equation not in system.lets:
        found = found / _of_name(system, TIME)
    return str(found) if _stated(found) else None


def unit_of(system: System, expr: Expr) -> Unit | None:
    """Return the unit of an expression; a name without a unit is its own symbol.

    Functions such as exp, and their arguments, are dimensionless. The result is None for a sum of
    different units, or a power with a non-numeric exponent.
    """
    match expr:
        case Number():
            return ONE
        case Name(id):
            return _of_name(system, id)
        case Product(factors):
            return _product([unit_of(system, factor) for factor in factors])
        case Sum(terms):
            units = {unit_of(system, term) for term in terms}
            return units.pop() if len(units) == 1 else None
        case Power(base, Number(n)):
            inner = unit_of(system, base)
            return None if inner is None else inner**n
        case Derivative(operand, axis, order):
            inner = unit_of(system, operand)
            return None if inner is None else inner / _of_name(system, axis) ** order
        case Flux(operand, axis, _):
            inner = unit_of(system, operand)
            return None if inner is None else inner / _of_name(system, axis)
        case Call(function, operand):
            return _of_call(system, function, unit_of(system, operand))
        case Where(_, positive, otherwise):
            units = {unit_of(system, branch) for branch in (positive, otherwise)}
            return units.pop() if len(units) == 1 else None
        case _:
            return None


def _of_call(system: System, function: str, inner: Unit | None) -> Unit | None:
    if function in ("lap", "inv_lap", "grad2"):
        along = {_of_name(system, axis.name) for axis in system.axes}
        if inner is None or len(along) != 1:
            return None
        area = along.pop() ** 2
        return {"lap": inner / area, "inv_lap": inner * area, "grad2": inner**2 / area}[function]
    power = FUNCTIONS[function].unit_power
    if power == 0.0:
        return ONE
    return None if inner is None else inner**power


def _of_name(system: System, name: str) -> Unit:
    stated = system.units.get(name)
    return Unit(((UNKNOWN + name, Fraction(1)),)) if stated is None else parse_unit(stated)


def _product(units: list[Unit | None]) -> Unit | None:
    total = ONE
    for unit in units:
        if unit is None:
            return None
        total = total * unit
    return total


def _stated(unit: Unit) -> bool:
    return not any(symbol.startswith(UNKNOWN) for symbol, _ in unit.powers)
