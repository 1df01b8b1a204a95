"""Evaluate a forcing in which most trajectories have most terms."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from dashred.physics.backends.torch_backend import Program
from dashred.physics.grids.grid_value import Value
from dashred.physics.grids.operators import Operators
from dashred.physics.solvers.forcing import Forcing, RowwiseForcing

# Measured on 192 trajectories of 256 points with 48 terms: to gather and scatter the trajectories
# that have a term costs about four times its evaluation on every trajectory.
DENSE_FRACTION = 0.25


class DenseForcing:
    """Evaluates every term on all trajectories, with common subexpressions computed once.

    It returns the values of :class:`RowwiseForcing`, up to rounding. Coefficients with one row are
    those of all trajectories.
    """

    def __init__(self, forcing: Forcing, fields: tuple[str, ...], operators: Operators) -> None:
        self.fields, self.operators = fields, operators
        self.program = Program([term.expression for term in forcing.terms])
        self.equations = [fields.index(term.equation) for term in forcing.terms]
        shape = (-1, *(1,) * len(operators.grid.shape))
        self.weights = [column.reshape(shape) for column in forcing.coefficients.T]
        self.zero = forcing.coefficients.new_zeros(())

    def __call__(self, values: Mapping[str, Value]) -> list[Value]:
        """Return the forcing of each field, given the values of :meth:`System.values`."""
        sums: list[Tensor] = [self.zero for _ in self.fields]
        result = self.program(values, self.operators)
        for equation, weight, value in zip(self.equations, self.weights, result, strict=True):
            points = torch.as_tensor(self.operators.on_grid(value)).to(weight)
            sums[equation] = torch.addcmul(sums[equation], weight, points)
        whole = (len(self.weights[0]), *self.operators.grid.shape)
        return [Value(each.expand(torch.broadcast_shapes(each.shape, whole))) for each in sums]


ForcingEvaluator = RowwiseForcing | DenseForcing


def forcing_evaluator(
    forcing: Forcing, fields: tuple[str, ...], operators: Operators
) -> ForcingEvaluator:
    """Return the cheaper evaluator for these coefficients."""
    nonzero = (forcing.coefficients != 0).double()
    if len(forcing.terms) and float(nonzero.mean()) >= DENSE_FRACTION:
        return DenseForcing(forcing, fields, operators)
    return RowwiseForcing(forcing, fields, operators)
