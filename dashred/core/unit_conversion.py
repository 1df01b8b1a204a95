"""Conversion of values between units of the same quantity."""

from __future__ import annotations

import math
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

# Names of units whose zero is not that of their scale. In a product they stand for differences.
OFFSET_UNITS = ("degree_Celsius", "degree_Fahrenheit")


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


def is_known_unit(unit: str) -> bool:
    """Return whether a unit can be converted."""
    return _between(unit, unit) is not None


@cache
def _between(unit: str, other: str) -> Conversion | None:
    # Imported here: it takes half a second, and most recordings need no conversion.
    import pint

    known, wanted = _known(unit), _known(other)
    if known is None or wanted is None or known.dimensionality != wanted.dimensionality:
        return None
    registry = _registry()
    try:
        if _angles(known) != _angles(wanted):
            return None
        zero, one, two = (
            float(registry.Quantity(value, known).to(wanted).magnitude) for value in (0.0, 1.0, 2.0)
        )
    except (pint.PintError, ArithmeticError, ValueError):
        return None
    if not math.isclose(two - zero, 2 * (one - zero), rel_tol=1e-6):
        # A logarithmic unit, such as a decibel.
        return None
    # The difference of two absolute temperatures would round the factor.
    factor = one if zero == 0 else round(one - zero, 12)
    return Conversion(factor, zero) if factor else None


def _known(unit: str) -> pint.Unit | None:
    """Return a unit of the registry; None if it does not contain one of the symbols."""
    import pint

    found, powers = _registry().Unit(""), parse_unit(unit).powers
    for symbol, power in powers:
        if not re.fullmatch(SYMBOL, symbol):
            # The parser of the registry reads any expression.
            return None
        try:
            each = _registry().parse_units(symbol)
            if str(each) in OFFSET_UNITS and (len(powers) > 1 or power != 1):
                each = _registry().parse_units(f"delta_{each}")
            found *= each ** float(power)
        except (pint.PintError, AttributeError, ArithmeticError, TypeError, ValueError):
            return None
    return found


def _angles(unit: pint.Unit) -> float:
    """Return the power of angles in a unit: they have no dimension, but 1 Hz is not 1 rad/s."""
    root = _registry().get_root_units(unit)[1]
    return float(str(dict(root._units).get("radian", 0)))


@cache
def _registry() -> pint.UnitRegistry[float]:
    import pint

    return pint.UnitRegistry()
