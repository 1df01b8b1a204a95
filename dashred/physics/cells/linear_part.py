"""The linear part of the equations of finite volumes, as a matrix."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from dashred.physics.backends.torch_backend import Program
from dashred.physics.expressions.algebra import (
    ZERO,
    Expr,
    Name,
    add,
    multiply,
    names,
    substitute,
    summands,
)
from dashred.physics.expressions.differentiate import NotDifferentiableError, differentiate
from dashred.physics.expressions.nodes import has_flux
from dashred.physics.grids.grid_value import Value
from dashred.physics.system import System

Array = NDArray[np.float64]

# Name of a common factor of all fields; it contains a space, so that it is no name of the language.
FACTOR = "common factor"


def linear_part(system: System) -> Array:
    """Return the matrix A of the terms that are linear in the fields and constant in time.

    Its order is that of the fields, then that of the cells: ``(n, n)``. Coefficients may depend on
    the place, as in ``d(kappa(x)*d(u, x), x)``.
    """
    fields, extension = system.fields, system.extension
    parts = [
        add(s for s in summands(expr) if is_linear(s, fields, system.clock))
        for expr in system.resolved.values()
    ]
    cells = extension.matrices.shape[2]
    units = torch.eye(len(fields) * cells, dtype=torch.float64)
    states = extension.homogeneous(units.reshape(-1, len(fields), cells))
    values = dict(zip(fields, map(Value, states.unbind(1)), strict=True))
    values |= {name: Value(x) for name, x in system.grid.places.items()}
    columns = [
        torch.as_tensor(system.operators.on_grid(value), dtype=torch.float64).expand(
            len(units), system.grid.shape[0]
        )
        for value in Program(parts)(values, system.operators)
    ]
    found: Array = extension.cells(torch.stack(columns, dim=1)).flatten(1).T.numpy()
    return np.ascontiguousarray(found)


def is_linear(expr: Expr, fields: Sequence[str], clock: frozenset[str]) -> bool:
    """Return whether an expression is linear in the fields, with coefficients constant in time.

    Args:
        expr: a summand of an equation, with lets and parameters substituted.
        fields: names of the fields.
        clock: names of functions of time.
    """
    if names(expr) & clock or not names(expr) & set(fields) or has_flux(expr):
        return False
    scaled = substitute(expr, {f: multiply((Name(FACTOR), Name(f))) for f in fields})
    try:
        slope = differentiate(scaled, FACTOR)
        return FACTOR not in names(slope) and substitute(scaled, {FACTOR: ZERO}) == ZERO
    except (NotDifferentiableError, ArithmeticError):
        return False
