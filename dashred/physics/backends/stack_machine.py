"""A stack machine in compiled code, for the programs of :mod:`.stack_program`."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from dashred.physics.backends.stack_program import Op

Array = NDArray[np.float64]

# Numba reads global integers, but no members of an enumeration, as constants.
_NUMBER, _READ, _WEIGHT = int(Op.NUMBER), int(Op.READ), int(Op.WEIGHT)
_ADD, _MULTIPLY, _POWER = int(Op.ADD), int(Op.MULTIPLY), int(Op.POWER)
_INVERT, _SQUARE, _CUBE = int(Op.INVERT), int(Op.SQUARE), int(Op.CUBE)
_UNLESS, _JUMP = int(Op.UNLESS), int(Op.JUMP)
_SIN, _COS, _TAN, _ATAN = int(Op.SIN), int(Op.COS), int(Op.TAN), int(Op.ATAN)
_EXP, _LOG, _SQRT, _ERF = int(Op.EXP), int(Op.LOG), int(Op.SQRT), int(Op.ERF)
_SINH, _COSH, _TANH, _SECH = int(Op.SINH), int(Op.COSH), int(Op.TANH), int(Op.SECH)
_ABS, _SIGN, _STEP = int(Op.ABS), int(Op.SIGN), int(Op.STEP)


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
        if op == _READ:
            top += 1
            stack[top] = values[int(arguments[at])]
        elif op == _NUMBER:
            top += 1
            stack[top] = arguments[at]
        elif op == _MULTIPLY:
            top -= 1
            stack[top] *= stack[top + 1]
        elif op == _ADD:
            top -= 1
            stack[top] += stack[top + 1]
        elif op == _SQUARE:
            stack[top] *= stack[top]
        elif op == _CUBE:
            stack[top] *= stack[top] * stack[top]
        elif op == _INVERT:
            stack[top] = 1.0 / stack[top]
        elif op == _POWER:
            top -= 1
            stack[top] = stack[top] ** stack[top + 1]
        elif op == _WEIGHT:
            top += 1
            stack[top] = weights[int(arguments[at])]
        elif op == _UNLESS:
            if not stack[top] > 0.0:
                at += int(arguments[at])
            top -= 1
        elif op == _JUMP:
            at += int(arguments[at])
        else:
            stack[top] = _function(op, stack[top])
        at += 1
    return float(stack[top])


@numba.njit(cache=True, error_model="numpy")
def _function(op: int, x: float) -> float:
    """Return the value of a function of one number; one branch for each function."""
    if op == _ABS:
        return abs(x)
    if op == _SIN:
        return math.sin(x)
    if op == _COS:
        return math.cos(x)
    if op == _SIGN:
        return 1.0 if x > 0.0 else (-1.0 if x < 0.0 else 0.0)
    if op == _STEP:
        return 1.0 if x > 0.0 else 0.0
    if op == _TANH:
        return math.tanh(x)
    if op == _EXP:
        return math.exp(x)
    if op == _SQRT:
        return math.sqrt(x)
    if op == _COSH:
        return math.cosh(x)
    if op == _SECH:
        return 1.0 / math.cosh(x)
    if op == _LOG:
        return math.log(x)
    if op == _TAN:
        return math.tan(x)
    if op == _ATAN:
        return math.atan(x)
    if op == _ERF:
        return math.erf(x)
    if op == _SINH:
        return math.sinh(x)
    return math.nan
