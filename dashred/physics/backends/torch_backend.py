"""Expressions compiled to batched torch operations; common subexpressions are computed once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import reduce

import torch
from torch import Tensor

from dashred.physics.expressions.algebra import (
    Call,
    Derivative,
    Expr,
    Flux,
    Name,
    Number,
    Power,
    Product,
    Sum,
    Where,
    children,
    names,
    split_coefficient,
)
from dashred.physics.expressions.functions import FUNCTIONS
from dashred.physics.grids.grid_value import Value, total
from dashred.physics.grids.operators import Operators

Step = Callable[[list[Value], Mapping[str, Value], Operators], Value]


class Program:
    """Evaluates several expressions together: ``program(values of names, operators)``.

    Attributes:
        names: names in the expressions.
    """

    def __init__(self, expressions: Sequence[Expr]) -> None:
        self.names = frozenset[str]().union(*map(names, expressions))
        self._slots: dict[Expr, int] = {}
        self._steps: list[Step] = []
        self._outputs = [self._compile(expression) for expression in expressions]

    def __call__(self, values: Mapping[str, Value], operators: Operators) -> list[Value]:
        """Return a :class:`Value` for each expression, given the values of all names."""
        memory: list[Value] = []
        for step in self._steps:
            memory.append(step(memory, values, operators))
        return [memory[slot] for slot in self._outputs]

    def _compile(self, expr: Expr) -> int:
        if expr not in self._slots:
            slots = [self._compile(child) for child in _operands(expr)]
            step = _flux(self, expr, slots) if isinstance(expr, Flux) else _step(expr, slots)
            self._slots[expr] = len(self._steps)
            self._steps.append(step)
        return self._slots[expr]


def _flux(program: Program, expr: Flux, slots: list[int]) -> Step:
    field = program._compile(Name(expr.transported))
    return lambda m, v, ops: ops.flux(m[slots[0]], expr.axis, m[field])


def _operands(expr: Expr) -> tuple[Expr, ...]:
    value, rest = split_coefficient(expr)
    return children(expr) if value == 1.0 or isinstance(expr, Number) else (rest,)


def _step(expr: Expr, slots: list[int]) -> Step:
    match expr:
        case Number(value):
            return lambda m, v, ops: Value(value)
        case Name(id):
            return lambda m, v, ops: v[id]
        case Sum():
            return lambda m, v, ops: total([m[slot] for slot in slots])
        case Product((Number(value), *_)):
            return lambda m, v, ops: m[slots[0]].scaled(value)
        case Product():
            return lambda m, v, ops: Value(
                reduce(lambda a, b: a * b, (ops.on_grid(m[slot]) for slot in slots))
            )
        case Power(_, Number(exponent)):
            return lambda m, v, ops: Value(_power(ops.on_grid(m[slots[0]]), exponent))
        case Power():
            return lambda m, v, ops: Value(_tensor(m[slots[0]], ops) ** _tensor(m[slots[1]], ops))
        case Derivative(_, axis, order):
            return lambda m, v, ops: ops.derivative(m[slots[0]], axis, order)
        case Call(function, _):
            return _call(function, slots[0])
        case Where():
            return lambda m, v, ops: Value(_choose(*(_tensor(m[slot], ops) for slot in slots)))
    raise TypeError(f"cannot compile {expr!r}")


def _call(function: str, slot: int) -> Step:
    match function:
        case "lap":
            return lambda m, v, ops: ops.laplacian(m[slot])
        case "inv_lap":
            return lambda m, v, ops: ops.inverse_laplacian(m[slot])
        case "grad2":
            return lambda m, v, ops: Value(_squared_gradient(m[slot], ops))
    compute = FUNCTIONS[function].arrays(torch)
    return lambda m, v, ops: Value(compute(_tensor(m[slot], ops)))


def _choose(condition: Tensor, positive: Tensor, otherwise: Tensor) -> Tensor:
    return torch.where(condition > 0, positive, otherwise)


def _squared_gradient(value: Value, operators: Operators) -> Tensor | float:
    slopes = [operators.derivative(value, axis.name, 1) for axis in operators.grid.axes]
    squares = [operators.on_grid(slope) ** 2 for slope in slopes]
    return reduce(lambda a, b: a + b, squares)


def _power(base: Tensor | float, exponent: float) -> Tensor | float:
    if exponent == 2.0:
        return base * base
    if exponent == 3.0:
        return base * base * base
    return base**exponent


def _tensor(value: Value, operators: Operators) -> Tensor:
    return torch.as_tensor(operators.on_grid(value), dtype=torch.float64)
