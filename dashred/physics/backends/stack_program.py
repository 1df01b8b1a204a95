"""Pointwise functions of one state as programs of a stack machine, in arrays of numbers.

A machine of compiled code runs the programs (:mod:`.stack_machine`). It is compiled once and kept
on disk, so that a new law of an ODE system costs no compilation. On a whole grid of points, a
compiled kernel (:mod:`.numba_backend`) is faster.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

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
)


class Op(IntEnum):
    """Instructions; most take their operands from the stack and leave the result on it.

    The argument of an instruction is a number or, for ``READ`` and ``WEIGHT``, an index. ``JUMP``
    skips so many instructions; ``UNLESS`` does so if the number on the stack is not positive.
    """

    NUMBER = 0
    READ = 1
    WEIGHT = 2
    ADD = 3
    MULTIPLY = 4
    POWER = 5
    INVERT = 6
    SQUARE = 7
    CUBE = 8
    UNLESS = 9
    JUMP = 10
    SIN = 11
    COS = 12
    TAN = 13
    EXP = 14
    LOG = 15
    SQRT = 16
    SINH = 17
    COSH = 18
    TANH = 19
    ATAN = 20
    ERF = 21
    SECH = 22
    ABS = 23
    SIGN = 24
    STEP = 25


# Powers with an own instruction.
_POWERS = {-1.0: Op.INVERT, 2.0: Op.SQUARE, 3.0: Op.CUBE}

Instruction = tuple[Op, float]


class StackPrograms(NamedTuple):
    """Several programs, one after the other.

    Attributes:
        ops: the instructions, ``(instruction,)``.
        arguments: their arguments, ``(instruction,)``.
        begins: first instruction of each program, and the end of the last, ``(1 + program,)``.
    """

    ops: NDArray[np.int64]
    arguments: NDArray[np.float64]
    begins: NDArray[np.int64]


@dataclass(frozen=True)
class NamePlaces:
    """Where a program finds the value of each name.

    Attributes:
        values: index among the values, by name.
        weights: column of the weights, by name.
    """

    values: Mapping[str, int]
    weights: Mapping[str, int]


def build_programs(pairs: Sequence[tuple[Expr, NamePlaces]]) -> StackPrograms:
    """Return the programs of expressions without spatial operators.

    Args:
        pairs: each expression with its names.

    Raises:
        TypeError: an expression is not pointwise.
    """
    codes = [_code(expr, names) for expr, names in pairs]
    flat = [instruction for code in codes for instruction in code]
    return StackPrograms(
        np.array([op for op, _ in flat], dtype=np.int64),
        np.array([argument for _, argument in flat], dtype=np.float64),
        np.cumsum([0, *map(len, codes)], dtype=np.int64),
    )


def stack_depth(programs: StackPrograms) -> int:
    """Return an upper bound of the number of values on the stack."""
    return int(np.diff(programs.begins).max(initial=0))


def _code(expr: Expr, names: NamePlaces) -> list[Instruction]:
    match expr:
        case Number(value):
            return [(Op.NUMBER, value)]
        case Name(id) if id in names.values:
            return [(Op.READ, float(names.values[id]))]
        case Name(id):
            return [(Op.WEIGHT, float(names.weights[id]))]
        case Sum(terms):
            return _chain(terms, Op.ADD, names)
        case Product(factors):
            return _chain(factors, Op.MULTIPLY, names)
        case Power(base, Number(n)) if n in _POWERS:
            return [*_code(base, names), (_POWERS[n], 0.0)]
        case Power(base, exponent):
            return [*_code(base, names), *_code(exponent, names), (Op.POWER, 0.0)]
        case Call(function, operand) if function.upper() in Op.__members__:
            return [*_code(operand, names), (Op[function.upper()], 0.0)]
        case Where(condition, positive, otherwise):
            first, second = _code(positive, names), _code(otherwise, names)
            return [
                *_code(condition, names),
                (Op.UNLESS, len(first) + 1.0),
                *first,
                (Op.JUMP, float(len(second))),
                *second,
            ]
    raise TypeError(f"{expr!r} is not pointwise")


def _chain(operands: Sequence[Expr], op: Op, names: NamePlaces) -> list[Instruction]:
    code = _code(operands[0], names)
    for operand in operands[1:]:
        code += [*_code(operand, names), (op, 0.0)]
    return code
