"""Fourier symbols of linear, constant-coefficient operators."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from dashred.physics.expressions.algebra import (
    Call,
    Derivative,
    Expr,
    Name,
    Sum,
    split_coefficient,
)
from dashred.physics.grids.spectral import Spectral


def symbol(expr: Expr, operators: Spectral, device: torch.device) -> Tensor | float:
    """Return the Fourier symbol of a linear operator: ``nu*lap(u)`` → ``-ν|k|²``.

    The symbol is real (float64) if all derivatives are even, and complex otherwise.
    """
    value, rest = split_coefficient(expr)
    match rest:
        case Name():
            return value
        case Sum(terms):
            parts = [symbol(term, operators, device) for term in terms]
            return value * sum(parts[1:], parts[0])
        case Derivative(operand, axis, order):
            multiplier = operators.multiplier(axis, order, device)
        case Call(function, operand):
            multiplier = operators.multiplier("", 2 if function == "lap" else -2, device)
        case _:
            raise TypeError(f"{rest!r} is not a linear operator")
    return value * multiplier * symbol(operand, operators, device)


def symbols(linear: Sequence[Sequence[Expr]], operators: Spectral, device: torch.device) -> Tensor:
    """Return the summed symbols of every field's linear terms, ``(field, *modes)``, complex."""
    *first, last = operators.grid.shape
    shape = (len(linear), *first, last // 2 + 1)
    rows = torch.zeros(shape, dtype=torch.complex128, device=device)
    for row, terms in zip(rows, linear, strict=True):
        for term in terms:
            row += symbol(term, operators, device)
    return rows
