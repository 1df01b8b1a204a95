"""Pointwise functions of one state, compiled to Python."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

from dashred.physics.backends.codegen import CodeWriter, define
from dashred.physics.expressions.algebra import Expr

ScalarProgram = Callable[..., tuple[float, ...]]
# What Python raises where an array would hold an infinity or no number (a fractional power of a
# negative number is complex, and no sine takes that).
NON_FINITE_ERRORS = (ArithmeticError, ValueError, TypeError)


def scalar_program(expressions: Sequence[Expr], names: Sequence[str]) -> ScalarProgram:
    """Return ``program(*values)``, which evaluates expressions of a few plain numbers.

    A call costs a tenth of what NumPy's cost of arrays of one element. It may raise one of
    ``NON_FINITE_ERRORS`` where arrays would hold what is not finite.

    Args:
        expressions: without spatial operators.
        names: what they may read, in the order of the values.
    """
    known = {name: f"n{i}" for i, name in enumerate(names)}
    writer = CodeWriter(known)
    found = "".join(f"{writer.write(expr)}, " for expr in expressions)
    lines = [*writer.lines, f"return ({found})"]
    source = "\n    ".join([f"def program({', '.join(known.values())}):", *lines])
    scope: dict[str, Any] = {"math": MATH, "inf": math.inf, "nan": math.nan}
    define(source, scope)
    program: ScalarProgram = scope["program"]
    return program


def _infinite_on_overflow(function: Callable[[float], float]) -> Callable[[float], float]:
    """Return a function that grows to infinity, as it does in arrays."""

    def compute(x: float) -> float:
        try:
            return function(x)
        except OverflowError:
            return math.inf

    return compute


# Far from its middle a window's cosh is too large for a number, and what is divided by it is 0.
OVERFLOWING = {"exp": _infinite_on_overflow(math.exp), "cosh": _infinite_on_overflow(math.cosh)}
MATH = SimpleNamespace(**{**vars(math), **OVERFLOWING})
