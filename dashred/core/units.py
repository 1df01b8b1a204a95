"""Units as products of powers of symbols: compared as text, and multiplied.

``m/s``, ``m s-1``, ``m s^-1`` and ``m·s⁻¹`` are the same unit. ``km`` and ``1000 m`` are different
units, and so are ``s`` and ``sec``: symbols are compared as text.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from types import MappingProxyType

from dashred.core.errors import InputError

MAX_LENGTH = 60
# Key of the unit of time.
TIME = "t"
# Units of a system that states none.
NO_UNITS: Mapping[str, str] = MappingProxyType({})
SYMBOL = r"[^\W\d_]+|[°%‰$€]+[^\W\d_]*"
EXPONENT = r"(?:\^|\*\*)?(?P<sign>[+-]?)(?P<digits>\d{1,2}(?:\.\d{1,2})?)"
SUPERSCRIPTS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
FACTOR = re.compile(rf"(?P<symbol>{SYMBOL}|1(?![\d.^*+-]))(?:{EXPONENT})?")
JOINT = re.compile(r"\s*(?P<over>/)\s*|\s*[*·⋅.]\s*|\s+")


@dataclass(frozen=True)
class Unit:
    """A product of powers, ``kg·m²/s²``.

    Attributes:
        powers: nonzero exponent of each symbol, in order of appearance.
    """

    powers: tuple[tuple[str, Fraction], ...] = ()

    def __eq__(self, other: object) -> bool:
        """Return whether two units are equal, whatever the order of their symbols."""
        return isinstance(other, Unit) and dict(self.powers) == dict(other.powers)

    def __hash__(self) -> int:
        """Return a hash that is equal for equal units."""
        return hash(frozenset(self.powers))

    def __mul__(self, other: Unit) -> Unit:
        """Return the product."""
        return _unit(self.powers, other.powers)

    def __truediv__(self, other: Unit) -> Unit:
        """Return the quotient."""
        return self * other**-1

    def __pow__(self, exponent: int | float | Fraction) -> Unit:
        """Return the power."""
        n = Fraction(exponent).limit_denominator(100)
        return Unit(tuple((symbol, power * n) for symbol, power in self.powers if n))

    def __str__(self) -> str:
        """Return the unit as text: ``rad/s^2``, ``kg m/s``, ``1/(m s)``, ``1`` if dimensionless."""
        return _format(self, " ", lambda n: f"^{n}")


ONE = Unit()


def parse_unit(text: str) -> Unit:
    """Parse a unit; a text that is not a product of powers is a single symbol.

    One pair of parentheses may follow the last ``/``: ``W/(m2 K)``.
    """
    plain = unicodedata.normalize("NFKC", text).replace("\N{MINUS SIGN}", "-")
    plain = " ".join(plain.split())
    above, bracket, below = plain.partition("/(")
    if bracket and below.endswith(")"):
        parts = _product(above), _product(below[:-1])
        if parts[0] is not None and parts[1] is not None:
            return parts[0] / parts[1]
    found = _product(plain)
    return Unit(((plain, Fraction(1)),)) if found is None else found


def same_unit(first: str, second: str) -> bool:
    """Return whether two texts are the same unit, up to notation but without conversion."""
    return parse_unit(first) == parse_unit(second)


def split_unit(text: str) -> tuple[str, str | None]:
    """Split a name from its unit: ``theta [rad]`` → ``theta``, ``rad``; None if there is none."""
    name, bracket, rest = text.strip().rpartition("[")
    if not bracket or not rest.endswith("]"):
        return text.strip(), None
    return name.strip(), rest[:-1].strip()


def check_unit(unit: str, what: str, where: str | None) -> str:
    """Return a unit as given by the user, stripped.

    Raises:
        InputError: it is empty, contains a bracket or a line break, or is too long.
    """
    tidy = unit.strip()
    if not tidy:
        hint = "omit the unit if it is unknown; write 1 for a dimensionless number"
        raise InputError(f"the unit of {what} is empty", where=where, hint=hint)
    if len(tidy) > MAX_LENGTH or "[" in tidy or "]" in tidy or not tidy.isprintable():
        problem = f"{tidy[:MAX_LENGTH]!r} is not a valid unit of {what}"
        raise InputError(problem, where=where, hint="units are written like m/s, kg m2 s-2, rad")
    return tidy


def check_same_unit(
    what: str, stated: str, stated_where: str, other: str | None, other_where: str
) -> None:
    """Check that two stated units of one quantity are the same.

    Raises:
        InputError: they differ; the message gives both units and both locations.
    """
    if other is None or same_unit(stated, other):
        return
    problem = f"{what} is in {stated} here, but in {other} in {other_where}"
    hint = "use the same unit in both places"
    raise InputError(problem, where=stated_where, hint=hint)


def label_with_unit(name: str, unit: str | None) -> str:
    """Return a label with its unit: ``theta [rad]``, or ``time`` without a unit."""
    return name if unit is None else f"{name} [{format_unit(unit)}]"


def time_label(units: Mapping[str, str]) -> str:
    """Return the label of the time axis for these units."""
    return label_with_unit("time", units.get(TIME))


def format_unit(unit: str) -> str:
    """Format a unit for printing: ``rad/s²``, ``kg·m/s``."""
    return _format(parse_unit(unit), "·", _superscript)


def with_unit(number: str, unit: str | None) -> str:
    """Append a unit, if there is one and it is not 1: ``−0.039 per s``, ``64.2 rad/s²``."""
    if unit is None or parse_unit(unit) == ONE:
        return number
    return f"{number} {per_unit(unit) or format_unit(unit)}"


def _superscript(n: str) -> str:
    return n.translate(SUPERSCRIPTS) if n.isdigit() else f"^{n}"


def per_unit(unit: str) -> str | None:
    """Return ``per s`` for ``1/s``; None unless the unit is one over a single symbol."""
    powers = parse_unit(unit).powers
    return f"per {powers[0][0]}" if len(powers) == 1 and powers[0][1] == -1 else None


def _product(text: str) -> Unit | None:
    """Parse a product of factors; None if the text is anything else."""
    powers: list[tuple[str, Fraction]] = []
    at, side = 0, 1
    while found := FACTOR.match(text, at):
        n = Fraction(found["digits"] or 1) * (-1 if found["sign"] == "-" else 1)
        if found["symbol"] != "1":
            powers.append((found["symbol"], side * n))
        if found.end() == len(text):
            return _unit(tuple(powers))
        joint = JOINT.match(text, found.end())
        if joint is None:
            return None
        at, side = joint.end(), -1 if joint["over"] else 1
    return None


def _unit(*products: tuple[tuple[str, Fraction], ...]) -> Unit:
    total: dict[str, Fraction] = {}
    for symbol, n in (pair for product in products for pair in product):
        total[symbol] = total.get(symbol, Fraction(0)) + n
    return Unit(tuple((symbol, n) for symbol, n in total.items() if n))


def _format(unit: Unit, times: str, raised: Callable[[str], str]) -> str:
    if len(unit.powers) == 1 and unit.powers[0][1] == 1:
        return unit.powers[0][0]

    def factor(symbol: str, n: Fraction) -> str:
        base = symbol if re.fullmatch(SYMBOL, symbol) else f"({symbol})"
        return base if n == 1 else base + raised(f"{float(n):g}")

    above = [factor(symbol, n) for symbol, n in unit.powers if n > 0]
    below = [factor(symbol, -n) for symbol, n in unit.powers if n < 0]
    over = times.join(below) if len(below) < 2 else f"({times.join(below)})"
    return (times.join(above) or "1") + (f"/{over}" if below else "")
