"""Symbols that behave like tensors and record the operations on them as expressions."""

# Python's operators need no docstrings.
# ruff: noqa: D105

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from dashred.physics.expressions import algebra
from dashred.physics.expressions.algebra import Expr, Number
from dashred.physics.expressions.functions import FUNCTIONS

OPERATORS = {"add": "+", "sub": "-", "mul": "*", "truediv": "/", "div": "/", "pow": "**"}
ALIASES = {
    "multiply": "mul",
    "subtract": "sub",
    "absolute": "abs",
    "divide": "div",
    "arctan": "atan",
}


class NotTraceableError(Exception):
    """An operation that has no counterpart in the equation language."""


class Symbol:
    """An expression that behaves like a tensor in arithmetic and in torch's functions."""

    def __init__(self, expr: Expr) -> None:
        self.expr = expr

    def __add__(self, other: Any) -> Symbol:
        return Symbol(algebra.add([self.expr, expression_of(other)]))

    def __sub__(self, other: Any) -> Symbol:
        return self + -symbol(other)

    def __rsub__(self, other: Any) -> Symbol:
        return symbol(other) + -self

    def __neg__(self) -> Symbol:
        return Symbol(algebra.scale(-1.0, self.expr))

    def __pos__(self) -> Symbol:
        return self

    def __mul__(self, other: Any) -> Symbol:
        return Symbol(algebra.multiply((self.expr, expression_of(other))))

    def __truediv__(self, other: Any) -> Symbol:
        return self * symbol(other) ** -1.0

    def __rtruediv__(self, other: Any) -> Symbol:
        return symbol(other) * self**-1.0

    def __pow__(self, other: Any) -> Symbol:
        return Symbol(algebra.power(self.expr, expression_of(other)))

    def __rpow__(self, other: Any) -> Symbol:
        return symbol(other) ** self

    __radd__, __rmul__ = __add__, __mul__

    def __abs__(self) -> Symbol:
        return function("abs", self)

    def __bool__(self) -> bool:
        raise NotTraceableError("a decision (if, while, and, or) that depends on the state")

    def __lt__(self, other: Any) -> bool:
        raise NotTraceableError("a comparison of the state; torch.sign(f) may be equivalent")

    __le__ = __gt__ = __ge__ = __lt__

    def __eq__(self, other: object) -> bool:
        raise NotTraceableError("a comparison of the state")

    __hash__ = None  # type: ignore[assignment]

    def __float__(self) -> float:
        raise NotTraceableError("a conversion of the state to a number (float, int, .item, math)")

    def __getattr__(self, name: str) -> Callable[..., Symbol]:
        if name.startswith("__"):
            raise AttributeError(name)

        def method(*others: Any, **settings: Any) -> Symbol:
            if settings:
                raise NotTraceableError(f"the function {name} with {next(iter(settings))}=")
            return function(name, self, *others)

        return method

    @classmethod
    def __torch_function__(
        cls,
        func: Callable[..., Any],
        types: Sequence[type],
        args: Sequence[Any] = (),
        kwargs: Mapping[str, Any] | None = None,
    ) -> Symbol:
        """Support ``torch.sin(symbol)`` and ``tensor * symbol``."""
        if kwargs:
            raise NotTraceableError(f"the function {func.__name__} with {next(iter(kwargs))}=")
        return function(func.__name__, *args)


def symbol(value: Any) -> Symbol:
    """Convert a number, a tensor with one element, or a symbol to a symbol.

    Raises:
        NotTraceableError: the value is none of these.
    """
    if isinstance(value, Symbol):
        return value
    try:
        number = float(value)
    except (TypeError, ValueError, RuntimeError):
        raise NotTraceableError(f"a {type(value).__name__} together with the state") from None
    if not math.isfinite(number):
        raise NotTraceableError(f"the number {number}")
    return Symbol(Number(number))


def function(name: str, *operands: Any) -> Symbol:
    """Apply a function of torch to symbols.

    Raises:
        NotTraceableError: the equation language does not have the function.
    """
    bare = name.strip("_").removeprefix("true_")
    bare = ALIASES.get(bare, bare)
    if bare[:1] == "r" and bare[1:] in OPERATORS:
        bare, operands = bare[1:], operands[::-1]
    found = [symbol(operand) for operand in operands]
    if bare in OPERATORS and len(found) == 2:
        return _apply_operator(OPERATORS[bare], *found)
    if len(found) == 1:
        [x] = found
        if bare in FUNCTIONS:
            return Symbol(algebra.call(bare, x.expr))
        if bare in COMPOSITES:
            return COMPOSITES[bare](x)
    raise NotTraceableError(f"the function {name}")


COMPOSITES: dict[str, Callable[[Symbol], Symbol]] = {
    "neg": lambda x: -x,
    "negative": lambda x: -x,
    "square": lambda x: x**2.0,
    "reciprocal": lambda x: x**-1.0,
    "sigmoid": lambda x: 1 / (1 + function("exp", -x)),
    "clone": lambda x: x,
}


def expression_of(value: Any) -> Expr:
    """Return the expression of a value that :func:`symbol` accepts."""
    return symbol(value).expr


def _apply_operator(sign: str, a: Symbol, b: Symbol) -> Symbol:
    match sign:
        case "+":
            return a + b
        case "-":
            return a - b
        case "*":
            return a * b
        case "/":
            return a / b
    return a**b
