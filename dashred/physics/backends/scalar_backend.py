"""Pointwise functions of one state, as generated Python functions of floats."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

from dashred.physics.backends.codegen import CodeWriter, define
from dashred.physics.expressions.algebra import Expr

ScalarProgram = Callable[..., tuple[float, ...]]
# Errors that Python raises where an array would contain an infinity or NaN. A TypeError comes from
# functions of the complex number that a fractional power of a negative number returns.
NON_FINITE_ERRORS = (ArithmeticError, ValueError, TypeError)


def scalar_program(expressions: Sequence[Expr], names: Sequence[str]) -> ScalarProgram:
    """Return ``program(*values)``, which evaluates expressions of floats.

    A call costs a tenth of NumPy operations on arrays of one element. It may raise one of
    ``NON_FINITE_ERRORS`` where an array would contain a non-finite value.

    Args:
        expressions: expressions without spatial operators.
        names: names in the expressions, in the order of the values.
    """
    known = {name: f"n{i}" for i, name in enumerate(names)}
    writer = CodeWriter(known)
    result = "".join(f"{writer.write(expr)}, " for expr in expressions)
    lines = [*writer.lines, f"return ({result})"]
    source = "\n    ".join([f"def program({', '.join(known.values())}):", *lines])
    scope: dict[str, Any] = {"math": MATH, "inf": math.inf, "nan": math.nan}
    define(source, scope)
    program: ScalarProgram = scope["program"]
    return program


def _infinite_on_overflow(function: Callable[[float], float]) -> Callable[[float], float]:
    """Return a function that returns infinity on overflow, as NumPy does."""

    def compute(x: float) -> float:
        try:
            return function(x)
        except OverflowError:
            return math.inf

    return compute


# Far from the centre of a window its cosh overflows; 1/cosh must then be 0.
OVERFLOWING = {"exp": _infinite_on_overflow(math.exp), "cosh": _infinite_on_overflow(math.cosh)}
MATH = SimpleNamespace(**{**vars(math), **OVERFLOWING})
