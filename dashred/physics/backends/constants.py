"""Constants of expressions as data, so that kernels that differ only in them are compiled once."""

from __future__ import annotations

from dataclasses import dataclass, field

from dashred.physics.expressions.algebra import Call, Expr, Name, Number, Power, Product, Sum


@dataclass
class Constants:
    """The constants that were taken out of expressions.

    Attributes:
        values: the constants, in the order in which they were met.
    """

    values: list[float] = field(default_factory=list)

    def take_out(self, expr: Expr) -> Expr:
        """Return a pointwise expression with a name in place of each constant but exponents."""
        match expr:
            case Number(value):
                self.values.append(value)
                return Name(self.name(len(self.values) - 1))
            case Sum(terms):
                return Sum(tuple(map(self.take_out, terms)))
            case Product(factors):
                return Product(tuple(map(self.take_out, factors)))
            case Power(base, exponent):
                return Power(self.take_out(base), exponent)
            case Call(function, operand):
                return Call(function, self.take_out(operand))
        return expr

    def columns(self, first: int) -> dict[str, int]:
        """Return the column of each constant by name, from the first column on."""
        return {self.name(k): first + k for k in range(len(self.values))}

    @staticmethod
    def name(index: int) -> str:
        """Return the name of a constant, which no name of a configuration can equal."""
        return f"constant {index}"
