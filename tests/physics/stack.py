"""Expressions on the stack machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from dashred.physics.backends.stack_machine import evaluate
from dashred.physics.backends.stack_program import NamePlaces, build_programs, stack_depth
from dashred.physics.expressions.algebra import Expr


def by_stack(
    expressions: Sequence[Expr],
    places: Mapping[str, int],
    values: Sequence[float],
    weights: Sequence[float] = (),
    columns: Mapping[str, int] | None = None,
) -> list[float]:
    """Return the values of expressions.

    Args:
        expressions: without spatial operators.
        places: index of each name among the values.
        values: the values.
        weights: weights of a row.
        columns: column of each name among the weights.
    """
    names = NamePlaces(places, columns or {})
    programs = build_programs([(expr, names) for expr in expressions])
    memory = np.empty(max(stack_depth(programs), 1))
    given, row = np.array(values, dtype=np.float64), np.array(weights, dtype=np.float64)
    ops, arguments, begins = programs
    return [
        evaluate(ops, arguments, begin, end, given, row, memory)
        for begin, end in zip(begins[:-1].tolist(), begins[1:].tolist(), strict=True)
    ]
