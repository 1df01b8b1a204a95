"""Conversion of values between units of the same quantity."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, TypeVar

from dashred.core.errors import InputError
from dashred.core.units import SYMBOL, parse_unit, same_unit

if TYPE_CHECKING:
    import numpy as np
    import pint
    from numpy.typing import NDArray

Values = TypeVar("Values", float, "NDArray[np.float64]")

# Angles and cycles have no dimension, but 1 Hz is not 1 rad/s.
ANGLES = frozenset({"rad", "deg", "°", "degree", "degrees", "radian", "radians", "turn", "turns"})
CYCLES = frozenset({"rpm", "rev", "cycle", "cycles", "revolution", "revolutions"})


@dataclass(frozen=True)
class Conversion:
    """``y = factor x + offset``.

    Attributes:
        factor: also converts differences, such as standard deviations.
        offset: not zero for temperatures alone.
    """

    factor: float = 1.0
    offset: float = 0.0

    def __call__(self, values: Values) -> Values:
        """Return values in the other unit."""
        return values if self == UNCHANGED else self.factor * values + self.offset


UNCHANGED = Conversion()


def conversion(what: str, unit: str, where: str, other: str, other_where: str) -> Conversion:
    """Return how values in a unit are converted to another one.

    Args:
        what: the quantity, for error messages.
        unit: of the values.
        where: location of this unit.
        other: unit that is wanted.
        other_where: location of that unit.

    Raises:
        InputError: the units are not of the same quantity, or one is not known.
    """
    if same_unit(unit, other):
        return UNCHANGED
    found = _between(unit, other)
    if found is None:
        problem = f"{what} is in {unit} here, but in {other} in {other_where}"
        hint = "these units cannot be converted into each other: correct one of them"
        raise InputError(problem, where=where, hint=hint)
    return found


@cache
def _between(unit: str, other: str) -> Conversion | None:
    # Imported here: it takes half a second, and most recordings need no conversion.
    import pint

    known, wanted = _known(unit), _known(other)
    if known is None or wanted is None or known.dimensionality != wanted.dimensionality:
        return None
    if _turns(unit) != _turns(other):
        return None
    registry = _registry()
    try:
        zero, one = (
            float(registry.Quantity(value, known).to(wanted).magnitude) for value in (0.0, 1.0)
        )
    except (pint.PintError, ArithmeticError):
        return None
    # The difference of two absolute temperatures would round the factor.
    factor = one if zero == 0 else round(one - zero, 12)
    return Conversion(factor, zero) if factor else None


def _known(unit: str) -> pint.Unit | None:
    """Return a unit of the registry; None if it does not contain one of the symbols."""
    import pint

    found = _registry().Unit("")
    for symbol, power in parse_unit(unit).powers:
        if not re.fullmatch(SYMBOL, symbol):
            # The parser of the registry reads any expression.
            return None
        try:
            found *= _registry().parse_units(symbol) ** float(power)
        except (pint.PintError, AttributeError, ArithmeticError, TypeError, ValueError):
            return None
    return found


def _turns(unit: str) -> float:
    """Return the power of angles in a unit."""
    powers = parse_unit(unit).powers
    return sum(float(power) for symbol, power in powers if symbol.lower() in ANGLES | CYCLES)


@cache
def _registry() -> pint.UnitRegistry[float]:
    import pint

    return pint.UnitRegistry()
