"""Extra terms added to a simulator, with coefficients of their own for each trajectory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from dashred.physics.backends.torch_backend import Program
from dashred.physics.expressions.algebra import Expr
from dashred.physics.grids.grid_value import Value
from dashred.physics.grids.operators import Operators
from dashred.physics.system import Term


@dataclass(frozen=True)
class Forcing:
    """``Σ_j ξ_bj θ_j(u_b)`` for trajectory b.

    Attributes:
        terms: the terms θ, lets and parameters resolved.
        coefficients: ξ, ``(batch, term)``, in the terms' own units.
    """

    terms: tuple[Term, ...]
    coefficients: Tensor


class RowwiseForcing:
    """Evaluates each term on those trajectories alone that carry it.

    A randomised ensemble gives a member two or three terms out of forty. One gather lays the
    carriers of each term side by side, each term works on its slice, one scatter adds up: the
    cost is that of the (trajectory, term) pairs, not of the library times the batch.
    """

    def __init__(self, forcing: Forcing, fields: tuple[str, ...], operators: Operators) -> None:
        self.fields, self.operators = fields, operators
        self.batch = len(forcing.coefficients)
        carriers: dict[Expr, list[tuple[int, int]]] = {}
        carried = forcing.coefficients != 0
        if forcing.coefficients.requires_grad:
            # At zero, too, the trajectory depends on its coefficient.
            carried = torch.ones_like(carried)
        for row, j in torch.nonzero(carried).tolist():
            carriers.setdefault(forcing.terms[j].expression, []).append((row, j))
        self.programs = [Program([expr]) for expr in carriers]
        self.sizes = [len(pairs) for pairs in carriers.values()]
        every = [pair for pairs in carriers.values() for pair in pairs]
        device = forcing.coefficients.device
        self.rows = torch.tensor([row for row, _ in every], device=device, dtype=torch.long)
        equations = [fields.index(forcing.terms[j].equation) for _, j in every]
        slots = [f * self.batch + row for f, (row, _) in zip(equations, every, strict=True)]
        self.slots = torch.tensor(slots, device=device, dtype=torch.long)
        columns = torch.tensor([j for _, j in every], device=device, dtype=torch.long)
        weights = forcing.coefficients[self.rows, columns]
        self.weights = weights.reshape(-1, *(1,) * len(operators.grid.shape))

    def __call__(self, values: Mapping[str, Value]) -> list[Value]:
        """Return the forcing of every field; ``values`` as :meth:`System.values` gives them."""
        if not self.programs:
            return [Value(0.0) for _ in self.fields]
        carried = [_split(values[name], self.rows, self.sizes) for name in self.fields]
        on_grid: list[Tensor] = []
        for slices, program, size in zip(
            zip(*carried, strict=True), self.programs, self.sizes, strict=True
        ):
            mine = dict(zip(self.fields, slices, strict=True))
            [value] = program({**values, **mine}, self.operators)
            found = torch.as_tensor(self.operators.on_grid(value), dtype=torch.float64)
            on_grid.append(found.expand(size, *self.operators.grid.shape))
        added = torch.cat(on_grid) * self.weights
        sums = added.new_zeros((len(self.fields) * self.batch, *added.shape[1:]))
        summed = sums.index_add(0, self.slots, added)
        return [Value(part) for part in torch.split(summed, self.batch)]


def _split(value: Value, rows: Tensor, sizes: list[int]) -> list[Value]:
    [(_, part)] = value.parts
    assert isinstance(part.points, Tensor)
    points = torch.split(part.points[rows], sizes)
    if part.modes is None:
        return [Value(p) for p in points]
    modes = torch.split(part.modes[rows], sizes)
    return [Value(p, m) for p, m in zip(points, modes, strict=True)]
