"""Python source code of pointwise expressions, one scalar per statement.

The code is generated from checked expression trees only and contains no text from the user. This
is the only module that executes generated code.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dashred.physics.expressions.algebra import (
    Call,
    Expr,
    Name,
    Number,
    Power,
    Product,
    Sum,
    Where,
)
from dashred.physics.expressions.functions import FUNCTIONS


class CodeWriter:
    """Writes expressions as statements; common subexpressions are computed once.

    Args:
        known: Python expression of each name.
    """

    def __init__(self, known: Mapping[str, str]) -> None:
        self.known = known
        self.lines: list[str] = []
        self.seen: dict[Expr, str] = {}

    def write(self, expr: Expr) -> str:
        """Append the statements of an expression and return the code of its value."""
        if isinstance(expr, Number):
            return f"({expr.value!r})"
        if expr not in self.seen:
            if isinstance(expr, Where):
                return self._write_branches(expr)
            code = self._code(expr)
            name = f"v{len(self.seen)}"
            self.lines.append(f"{name} = {code}")
            self.seen[expr] = name
        return self.seen[expr]

    def _write_branches(self, expr: Where) -> str:
        """Append an if statement: only one branch is computed, the other may have no value."""
        condition, code = self.write(expr.condition), []
        for branch in (expr.positive, expr.otherwise):
            writer = CodeWriter(self.known)
            writer.seen = dict(self.seen)
            code.append((writer.lines, writer.write(branch)))
        name = f"v{len(self.seen)}"
        for head, (lines, value) in zip((f"if {condition} > 0.0:", "else:"), code, strict=True):
            self.lines += [head, *(f"    {line}" for line in (*lines, f"{name} = {value}"))]
        self.seen[expr] = name
        return name

    def _code(self, expr: Expr) -> str:
        match expr:
            case Name(id):
                return self.known[id]
            case Sum(terms):
                return " + ".join(map(self.write, terms))
            case Product(factors):
                return " * ".join(map(self.write, factors))
            case Power(base, Number(2.0)):
                value = self.write(base)
                return f"{value} * {value}"
            case Power(base, Number(3.0)):
                value = self.write(base)
                return f"{value} * {value} * {value}"
            case Power(base, Number(-1.0)):
                return f"1.0 / {self.write(base)}"
            case Power(base, exponent):
                return f"{self.write(base)} ** {self.write(exponent)}"
            case Call(function, operand) if function in FUNCTIONS:
                return FUNCTIONS[function].code.format(self.write(operand))
        raise TypeError(f"{expr!r} is not pointwise")


def define(source: str, scope: dict[str, Any]) -> None:
    """Define functions in a scope.

    Args:
        source: function definitions whose bodies are written by :class:`CodeWriter`.
        scope: names that the code uses; the functions are added to it.
    """
    exec(source, scope)
