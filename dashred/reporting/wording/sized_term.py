"""A term with its coefficient, standard deviation and unit, and its description."""

from __future__ import annotations

from dataclasses import dataclass

from dashred.core.formatting import MINUS, parenthesize_sum, pretty, with_error
from dashred.core.units import TIME, format_unit, with_unit
from dashred.physics.expressions import algebra
from dashred.physics.expressions.algebra import ONE, Expr, Name, Number, Power, Product
from dashred.physics.system import System
from dashred.physics.terms.term_units import coefficient_unit


def meaning(system: System, field: str) -> str:
    """Return the meaning of a field without its unit, such as ``angular velocity``."""
    return system.config.fields[field].split("(")[0].strip() or field


@dataclass(frozen=True)
class Description:
    """The effect and the size of a term.

    Attributes:
        effect: the physical effect, such as ``viscous damping of angular velocity``.
        size: coefficient, half-width of its interval and unit, such as ``−0.0251 ± 0.0008 per s``.
        separator: text between the two in a sentence.
    """

    effect: str
    size: str
    separator: str = ", "

    @property
    def text(self) -> str:
        """Effect and size in one text."""
        return f"{self.effect}{self.separator}{self.size}"


class SizedTerm:
    """A coefficient with its error times an expression, in the equation of one field."""

    def __init__(self, system: System, equation: str, expr: Expr, value: float, std: float) -> None:
        self.system, self.equation, self.expr = system, equation, expr
        self.value, self.std = value, std
        self.field_meaning = meaning(system, equation)
        self.factors = expr.factors if isinstance(expr, Product) else (expr,)
        self.unit = coefficient_unit(system, equation, expr)

    @property
    def text(self) -> str:
        """The term as text, such as ``(−0.0251 ± 0.0008)·u³ per unit time``."""
        if self.expr == ONE:
            return self.coefficient_text
        product = f"({self.size()})·{parenthesize_sum(format_expression(self.expr))}"
        return product if self.unit else f"{product} {self.rate}"

    @property
    def coefficient_text(self) -> str:
        """The coefficient as text, such as ``−0.0251 ± 0.0008 per s``."""
        return self.size() if self.unit else f"{self.size()} {self.rate}"

    @property
    def rate(self) -> str:
        """The unit of time of a rate of change, such as ``per s``."""
        unit = self.system.units.get(TIME)
        return f"per {format_unit(unit) if unit else 'unit time'}"

    def size(self, factor: float = 1.0) -> str:
        """Return the coefficient times a factor, with its error, and with its unit if known."""
        size = with_error(factor * self.value, abs(factor) * self.std)
        return with_unit(size, self.unit)

    @property
    def is_velocity(self) -> bool:
        """Whether the field is the velocity of another field: ``theta' = omega``."""
        return bool(self.positions)

    @property
    def positions(self) -> list[str]:
        """The fields whose rate of change is this field."""
        equations = self.system.equations
        return [f for f in equations if f != self.equation and equations[f] == Name(self.equation)]

    def powers(self) -> dict[str, int] | None:
        """Return the exponent of each field, or None if the term is not a monomial of fields."""
        result: dict[str, int] = {}
        for factor in self.factors:
            match factor:
                case Name(id) if id in self.system.fields:
                    result[id] = result.get(id, 0) + 1
                case Power(Name(id), Number(n)) if (
                    id in self.system.fields and n > 0 and n % 1 == 0
                ):
                    result[id] = result.get(id, 0) + int(n)
                case _:
                    return None
        return result


def format_expression(expr: Expr) -> str:
    """Return an expression as text, such as ``u²·lam``."""
    return pretty(algebra.to_text(expr)).replace("-", MINUS)
