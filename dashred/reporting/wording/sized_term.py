"""A term with its factors, its coefficient, error and unit; and the description of a term."""

from __future__ import annotations

from dataclasses import dataclass

from dashred.core.formatting import MINUS, pretty, with_error
from dashred.core.units import TIME, format_unit, with_unit
from dashred.physics.expressions import algebra
from dashred.physics.expressions.algebra import ONE, Expr, Name, Number, Power, Product
from dashred.physics.system import System
from dashred.physics.term_units import coefficient_unit


def meaning(system: System, field: str) -> str:
    """Return what a field stands for, without its unit: ``angular velocity``."""
    return system.config.fields[field].split("(")[0].strip() or field


@dataclass(frozen=True)
class Description:
    """What a term does, and how large it is.

    Attributes:
        effect: the physical effect: ``viscous damping of angular velocity``.
        size: coefficient, error and unit: ``−0.0251 ± 0.0004 per s``.
        joint: what stands between the two in a sentence.
    """

    effect: str
    size: str
    joint: str = ", "

    @property
    def text(self) -> str:
        """Effect and size."""
        return f"{self.effect}{self.joint}{self.size}"


class SizedTerm:
    """``value ± std`` times an expression, in the equation of one field."""

    def __init__(self, system: System, equation: str, expr: Expr, value: float, std: float) -> None:
        self.system, self.equation, self.expr = system, equation, expr
        self.value, self.std = value, std
        self.what = meaning(system, equation)
        self.factors = expr.factors if isinstance(expr, Product) else (expr,)
        self.unit = coefficient_unit(system, equation, expr)

    @property
    def amount(self) -> str:
        """``(−0.0251 ± 0.0004)·u³ per unit time``, ``(0.12 ± 0.01 rad/s²)·sin(theta)``."""
        if self.expr == ONE:
            return self.amount_alone
        product = f"({self.size()})·{printed(self.expr)}"
        return product if self.unit else f"{product} {self.rate}"

    @property
    def amount_alone(self) -> str:
        """The same without the expression: ``−0.0251 ± 0.0004 per s``."""
        return self.size() if self.unit else f"{self.size()} {self.rate}"

    @property
    def rate(self) -> str:
        """The unit of time of a rate of change: ``per s``."""
        unit = self.system.units.get(TIME)
        return f"per {format_unit(unit) if unit else 'unit time'}"

    def size(self, factor: float = 1.0) -> str:
        """Return the coefficient with its error, times a number, and its unit where it is known."""
        size = with_error(factor * self.value, abs(factor) * self.std)
        return with_unit(size, self.unit)

    @property
    def is_velocity(self) -> bool:
        """Whether the field is the velocity of another: ``theta' = omega``."""
        return bool(self.positions)

    @property
    def positions(self) -> list[str]:
        """The fields whose rate of change this field is."""
        equations = self.system.equations
        return [f for f in equations if f != self.equation and equations[f] == Name(self.equation)]

    def powers(self) -> dict[str, int] | None:
        """Return the exponent of each field; None if the term is no monomial of fields."""
        found: dict[str, int] = {}
        for factor in self.factors:
            match factor:
                case Name(id) if id in self.system.fields:
                    found[id] = found.get(id, 0) + 1
                case Power(Name(id), Number(n)) if (
                    id in self.system.fields and n > 0 and n % 1 == 0
                ):
                    found[id] = found.get(id, 0) + int(n)
                case _:
                    return None
        return found


def printed(expr: Expr) -> str:
    """Return an expression as it is printed: ``u²·lam``."""
    return pretty(algebra.to_text(expr)).replace("-", MINUS)
