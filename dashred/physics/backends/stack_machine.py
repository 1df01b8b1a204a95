"""A stack machine in compiled code, for the programs of :mod:`.stack_program`."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from dashred.physics.backends.stack_program import Op

Array = NDArray[np.float64]


@numba.njit(cache=True, error_model="numpy")
def evaluate(
    ops: NDArray[np.int64],
    arguments: Array,
    begin: int,
    end: int,
    values: Array,
    weights: Array,
    stack: Array,
) -> float:
    """Return the value of one program.

    Args:
        ops: instructions of all programs, ``(instruction,)``.
        arguments: their arguments, ``(instruction,)``.
        begin: first instruction of the program.
        end: the instruction after its last.
        values: values of the names, ``(name,)``.
        weights: weights of the row, ``(weight,)``.
        stack: memory for the stack, at least as large as the program is long.
    """
    top, at = -1, begin
    while at < end:
        op = ops[at]
        if op == Op.READ:
            top += 1
            stack[top] = values[int(arguments[at])]
        elif op == Op.NUMBER:
            top += 1
            stack[top] = arguments[at]
        elif op == Op.MULTIPLY:
            top -= 1
            stack[top] *= stack[top + 1]
        elif op == Op.ADD:
            top -= 1
            stack[top] += stack[top + 1]
        elif op == Op.SQUARE:
            stack[top] *= stack[top]
        elif op == Op.CUBE:
            stack[top] *= stack[top] * stack[top]
        elif op == Op.INVERT:
            stack[top] = 1.0 / stack[top]
        elif op == Op.POWER:
            top -= 1
            stack[top] = stack[top] ** stack[top + 1]
        elif op == Op.WEIGHT:
            top += 1
            stack[top] = weights[int(arguments[at])]
        elif op == Op.UNLESS:
            if not stack[top] > 0.0:
                at += int(arguments[at])
            top -= 1
        elif op == Op.JUMP:
            at += int(arguments[at])
        else:
            stack[top] = _function(op, stack[top])
        at += 1
    return float(stack[top])


@numba.njit(cache=True, error_model="numpy")
def _function(op: int, x: float) -> float:
    """Return the value of a function of one number; one branch for each function."""
    if op == Op.ABS:
        return abs(x)
    if op == Op.SIN:
        return math.sin(x)
    if op == Op.COS:
        return math.cos(x)
    if op == Op.SIGN:
        return 1.0 if x > 0.0 else (-1.0 if x < 0.0 else 0.0)
    if op == Op.STEP:
        return 1.0 if x > 0.0 else 0.0
    if op == Op.TANH:
        return math.tanh(x)
    if op == Op.EXP:
        return math.exp(x)
    if op == Op.SQRT:
        return math.sqrt(x)
    if op == Op.COSH:
        return math.cosh(x)
    if op == Op.SECH:
        return 1.0 / math.cosh(x)
    if op == Op.LOG:
        return math.log(x)
    if op == Op.TAN:
        return math.tan(x)
    if op == Op.ATAN:
        return math.atan(x)
    if op == Op.ERF:
        return math.erf(x)
    if op == Op.SINH:
        return math.sinh(x)
    return math.nan
