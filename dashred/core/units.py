"""Units as products of powers of symbols: compared, multiplied and written, never converted.

``m/s``, ``m s-1``, ``m s^-1`` and ``m·s⁻¹`` are the same unit; ``km`` and ``1000 m`` are not, nor
are ``s`` and ``sec``: a symbol is what it is written, and no table says what it stands for.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from types import MappingProxyType

from dashred.core.errors import InputError

LONGEST = 60
# What a reader calls time, whatever the equations read.
TIME = "t"
# Where no unit is stated.
NONE: Mapping[str, str] = MappingProxyType({})
SYMBOL = r"[^\W\d_]+|[°%‰$€]+[^\W\d_]*"
EXPONENT = r"(?:\^|\*\*)?(?P<sign>[+-]?)(?P<digits>\d{1,2}(?:\.\d{1,2})?)"
RAISED = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
FACTOR = re.compile(rf"(?P<symbol>{SYMBOL}|1(?![\d.^*+-]))(?:{EXPONENT})?")
JOINT = re.compile(r"\s*(?P<over>/)\s*|\s*[*·⋅.]\s*|\s+")


@dataclass(frozen=True)
class Unit:
    """A product of powers, ``kg·m²/s²``.

    Attributes:
        powers: the exponent, not 0, of each symbol, in the order in which they were met.
    """

    powers: tuple[tuple[str, Fraction], ...] = ()

    def __eq__(self, other: object) -> bool:
        """The order in which symbols are written does not matter."""
        return isinstance(other, Unit) and dict(self.powers) == dict(other.powers)

    def __hash__(self) -> int:
        """Return equal hashes of equal units."""
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
        """``rad/s^2``, ``kg m/s``, ``1/(m s)``, ``1`` of a number."""
        return _written(self, " ", lambda n: f"^{n}")


ONE = Unit()


def parse_unit(text: str) -> Unit:
    """Read a unit; a text that is no product of powers is a symbol of its own.

    One pair of parentheses may stand after the last ``/``: ``W/(m2 K)``.
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
    """Whether two texts are the same unit; spelled otherwise is the same, converted is not."""
    return parse_unit(first) == parse_unit(second)


def split_unit(text: str) -> tuple[str, str | None]:
    """Take a name and its unit apart: ``theta [rad]`` → ``theta``, ``rad``; None without one."""
    name, bracket, rest = text.strip().rpartition("[")
    if not bracket or not rest.endswith("]"):
        return text.strip(), None
    return name.strip(), rest[:-1].strip()


def check_unit(unit: str, what: str, where: str | None) -> str:
    """Return a unit as the user gave it, blanks aside.

    Raises:
        InputError: it is empty, holds a bracket or a line break, or is longer than a unit is.
    """
    tidy = unit.strip()
    if not tidy:
        hint = "leave the unit out where there is none; write 1 for a pure number"
        raise InputError(f"the unit of {what} is empty", where=where, hint=hint)
    if len(tidy) > LONGEST or "[" in tidy or "]" in tidy or not tidy.isprintable():
        problem = f"{tidy[:LONGEST]!r} cannot be the unit of {what}"
        raise InputError(problem, where=where, hint="units are written like m/s, kg m2 s-2, rad")
    return tidy


def check_same(
    what: str, stated: str, stated_where: str, other: str | None, other_where: str
) -> None:
    """Refuse two units of one thing that differ.

    Raises:
        InputError: with both units and both places.
    """
    if other is None or same_unit(stated, other):
        return
    problem = f"{what} is in {stated} here, but in {other} in {other_where}"
    hint = "units are compared as they are written, and nothing is converted: make both sides equal"
    raise InputError(problem, where=stated_where, hint=hint)


def in_brackets(name: str, unit: str | None) -> str:
    """A label with its unit: ``theta [rad]``, ``time`` where there is none."""
    return name if unit is None else f"{name} [{shown(unit)}]"


def time_label(units: Mapping[str, str]) -> str:
    """What an axis of time is called, of a system with these units."""
    return in_brackets("time", units.get(TIME))


def shown(unit: str) -> str:
    """A unit as it is printed: ``rad/s²``, ``kg·m/s``."""
    return _written(parse_unit(unit), "·", _superscript)


def measured(number: str, unit: str | None) -> str:
    """A number as it is told: ``−0.039 per s``, ``64.2 rad/s²``; alone without a unit, or of 1."""
    if unit is None or parse_unit(unit) == ONE:
        return number
    return f"{number} {per(unit) or shown(unit)}"


def _superscript(n: str) -> str:
    return n.translate(RAISED) if n.isdigit() else f"^{n}"


def per(unit: str) -> str | None:
    """``per s`` of ``1/s``; None of what is more than one over a single symbol."""
    powers = parse_unit(unit).powers
    return f"per {powers[0][0]}" if len(powers) == 1 and powers[0][1] == -1 else None


def _product(text: str) -> Unit | None:
    """Read factors one after the other; None where something else stands among them."""
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


def _written(unit: Unit, times: str, raised: Callable[[str], str]) -> str:
    if len(unit.powers) == 1 and unit.powers[0][1] == 1:
        return unit.powers[0][0]

    def factor(symbol: str, n: Fraction) -> str:
        base = symbol if re.fullmatch(SYMBOL, symbol) else f"({symbol})"
        return base if n == 1 else base + raised(f"{float(n):g}")

    above = [factor(symbol, n) for symbol, n in unit.powers if n > 0]
    below = [factor(symbol, -n) for symbol, n in unit.powers if n < 0]
    over = times.join(below) if len(below) < 2 else f"({times.join(below)})"
    return (times.join(above) or "1") + (f"/{over}" if below else "")
