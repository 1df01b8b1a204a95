"""Pointwise functions evaluated by NumPy, fast for many summands on few points."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from operator import add, mul

import numpy as np
from numpy.typing import NDArray

from dashred.physics.expressions.algebra import (
    Call,
    Expr,
    Name,
    Number,
    Power,
    Product,
    Sum,
    Where,
    children,
    split_coefficient,
    summands,
)
from dashred.physics.expressions.functions import FUNCTIONS

Array = NDArray[np.float64]
Points = Array | float
Step = Callable[[list[Points], Mapping[str, Array]], Points]


class Pointwise:
    """Evaluates functions ``G_m = Σ_j w_mj b_j`` together.

    Each different summand b_j is evaluated once; a matrix product gives all sums. One trajectory
    has few points, so call overhead dominates the cost. NumPy's overhead is a fifth of torch's.

    Args:
        functions: expressions without spatial operators.
    """

    def __init__(self, functions: Sequence[Expr]) -> None:
        self._slots: dict[Expr, int] = {}
        self._steps: list[Step] = []
        split = [[split_coefficient(term) for term in summands(expr)] for expr in functions]
        self._count = len(functions)
        self._sums = [m for m, terms in enumerate(split) if len(terms) > 1]
        basis = dict.fromkeys(rest for m in self._sums for _, rest in split[m])
        column = {expr: j for j, expr in enumerate(basis)}
        self._weights = np.zeros((len(self._sums), len(basis)))
        for weights, m in zip(self._weights, self._sums, strict=True):
            for value, rest in split[m]:
                weights[column[rest]] = value
        self._rows = [self._compile(expr) for expr in basis]
        # In the matrix product, one summand would cost as much as all of them.
        self._single = [
            (m, terms[0][0], self._compile(terms[0][1]))
            for m, terms in enumerate(split)
            if len(terms) == 1
        ]

    def __call__(self, values: Mapping[str, Array], shape: tuple[int, ...]) -> Array:
        """Return the functions, ``(function, *shape)``; ``values`` broadcast to ``shape``."""
        memory: list[Points] = []
        rows = np.empty((len(self._rows), *shape))
        result = np.empty((self._count, *shape))
        # A blow-up shows as non-finite values, as in torch, and not as a warning.
        with np.errstate(all="ignore"):
            for step in self._steps:
                memory.append(step(memory, values))
            for row, slot in zip(rows, self._rows, strict=True):
                row[...] = memory[slot]
            for m, value, slot in self._single:
                np.multiply(memory[slot], value, out=result[m])
            if self._sums:
                flat = rows.reshape(len(rows), math.prod(shape))
                result[self._sums] = (self._weights @ flat).reshape(-1, *shape)
        return result

    def _compile(self, expr: Expr) -> int:
        if expr not in self._slots:
            step = self._step(expr)
            self._slots[expr] = len(self._steps)
            self._steps.append(step)
        return self._slots[expr]

    def _step(self, expr: Expr) -> Step:
        if isinstance(expr, Number):
            return lambda m, v: expr.value
        if isinstance(expr, Sum) or split_coefficient(expr)[0] != 1.0:
            split = [split_coefficient(term) for term in summands(expr)]
            terms = [(value, self._compile(rest)) for value, rest in split]
            return lambda m, v: reduce(add, [m[s] if c == 1.0 else c * m[s] for c, s in terms])
        slots = [self._compile(child) for child in children(expr)]
        match expr:
            case Name(id):
                return lambda m, v: v[id]
            case Product():
                return lambda m, v: reduce(mul, [m[slot] for slot in slots])
            case Power(_, Number(exponent)) if exponent in PRODUCTS:
                multiplied = PRODUCTS[exponent]
                return lambda m, v: multiplied(m[slots[0]])
            case Power():
                return lambda m, v: np.power(m[slots[0]], m[slots[1]])
            case Call(function, _) if function in FUNCTIONS:
                compute = FUNCTIONS[function].arrays(np)
                return lambda m, v: compute(m[slots[0]])
            case Where():
                condition, *branches = slots
                return lambda m, v: np.where(np.greater(m[condition], 0), *(m[s] for s in branches))
        raise TypeError(f"{expr!r} is not pointwise")


def _fifth(x: Points) -> Points:
    square = x * x
    return square * square * x


def _sixth(x: Points) -> Points:
    cube = x * x * x
    return cube * cube


PRODUCTS: dict[float, Callable[[Points], Points]] = {
    -2.0: lambda x: 1 / (x * x),
    -1.0: lambda x: 1 / x,
    0.5: np.sqrt,
    2.0: lambda x: x * x,
    3.0: lambda x: x * x * x,
    4.0: lambda x: (x * x) * (x * x),
    5.0: _fifth,
    6.0: _sixth,
}
"""Powers that are computed without ``np.power``."""
