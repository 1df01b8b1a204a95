"""Pointwise functions of many summands, evaluated fast on few points."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from operator import mul

import numpy as np
from numpy.typing import NDArray

from dashred.physics.algebra import (
    Call,
    Expr,
    Name,
    Number,
    Power,
    Product,
    Sum,
    children,
    split_coefficient,
    summands,
)

Array = NDArray[np.float64]
Points = Array | float
Step = Callable[[list[Points], Mapping[str, Array]], Points]


class Pointwise:
    """``G_m = Σ_j w_mj b_j``: each summand b_j once for all functions, then one matrix product.

    In NumPy, since the state of one trajectory has few points: there an operation costs what
    its call costs, and NumPy's calls cost a fifth of torch's.

    Args:
        functions: expressions without spatial operators.
    """

    def __init__(self, functions: Sequence[Expr]) -> None:
        self._slots: dict[Expr, int] = {}
        self._steps: list[Step] = []
        split = [[split_coefficient(term) for term in summands(expr)] for expr in functions]
        basis = dict.fromkeys(rest for terms in split for _, rest in terms)
        column = {expr: j for j, expr in enumerate(basis)}
        self._weights = np.zeros((len(functions), len(basis)))
        for weights, terms in zip(self._weights, split, strict=True):
            for value, rest in terms:
                weights[column[rest]] = value
        self._rows = [self._compile(expr) for expr in basis]

    def __call__(self, values: Mapping[str, Array], shape: tuple[int, ...]) -> Array:
        """Return the functions, ``(function, *shape)``; ``values`` broadcast to ``shape``."""
        memory: list[Points] = []
        rows = np.empty((len(self._rows), *shape))
        # A trajectory that blows up is told by its values, as torch does.
        with np.errstate(all="ignore"):
            for step in self._steps:
                memory.append(step(memory, values))
            for row, slot in zip(rows, self._rows, strict=True):
                row[...] = memory[slot]
            found: Array = self._weights @ rows.reshape(len(rows), math.prod(shape))
        return found.reshape(len(found), *shape)

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
            return lambda m, v: sum(m[s] if c == 1.0 else c * m[s] for c, s in terms)
        slots = [self._compile(child) for child in children(expr)]
        match expr:
            case Name(id):
                return lambda m, v: v[id]
            case Product():
                return lambda m, v: reduce(mul, [m[slot] for slot in slots])
            case Power(_, Number(2.0)):
                return lambda m, v: m[slots[0]] * m[slots[0]]
            case Power(_, Number(3.0)):
                return lambda m, v: m[slots[0]] * m[slots[0]] * m[slots[0]]
            case Power():
                return lambda m, v: np.power(m[slots[0]], m[slots[1]])
            case Call(function, _) if function in FUNCTIONS:
                compute = FUNCTIONS[function]
                return lambda m, v: compute(m[slots[0]])
        raise TypeError(f"{expr!r} is not pointwise")


FUNCTIONS: dict[str, Callable[[Points], Array]] = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "exp": np.exp,
    "log": np.log,
    "sqrt": np.sqrt,
    "tanh": np.tanh,
    "sech": lambda x: 1 / np.cosh(x),
    "abs": np.abs,
    "sign": np.sign,
    "step": lambda x: np.heaviside(x, 0.0),
}
