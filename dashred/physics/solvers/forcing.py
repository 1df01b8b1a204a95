"""Terms added to a simulator, with separate coefficients for each trajectory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from dashred.physics.backends.torch_backend import Program
from dashred.physics.expressions.algebra import Expr
from dashred.physics.grids.grid_value import Value
from dashred.physics.grids.operators import Operators
from dashred.physics.program_parameters import added_terms, changed_parameter
from dashred.physics.system import Term


@dataclass(frozen=True)
class Forcing:
    """``Σ_j ξ_bj θ_j(u_b)`` for trajectory b.

    Attributes:
        terms: the terms θ, lets and parameters resolved.
        coefficients: ξ, ``(batch, term)``, in the units of the terms.
    """

    terms: tuple[Term, ...]
    coefficients: Tensor

    def added(self) -> Forcing:
        """Return the part that is added to equations."""
        kept = [j for j, term in enumerate(self.terms) if changed_parameter(term) is None]
        return Forcing(added_terms(self.terms), self.coefficients[:, kept])

    def to(self, device: torch.device) -> Forcing:
        """Return the forcing with its coefficients on a device."""
        return Forcing(self.terms, self.coefficients.to(device))

    def parameter_changes(self) -> dict[str, Tensor]:
        """Return the changes of the parameters of a program by name, ``(batch,)`` each."""
        found: dict[str, Tensor] = {}
        for term, values in zip(self.terms, self.coefficients.T, strict=True):
            name = changed_parameter(term)
            if name is not None:
                found[name] = values + found.get(name, 0.0)
        return found


class RowwiseForcing:
    """Evaluates each term only on the trajectories with a nonzero coefficient.

    A member of a randomised ensemble has two or three terms out of forty. One gather operation
    collects the trajectories of each term, each term is evaluated on its slice, and one scatter
    operation adds the results. The cost is proportional to the number of (trajectory, term) pairs.
    """

    def __init__(self, forcing: Forcing, fields: tuple[str, ...], operators: Operators) -> None:
        self.fields, self.operators = fields, operators
        self.batch = len(forcing.coefficients)
        pairs_of_term: dict[Expr, list[tuple[int, int]]] = {}
        is_needed = forcing.coefficients != 0
        if forcing.coefficients.requires_grad:
            # The gradient is also needed where a coefficient is zero.
            is_needed = torch.ones_like(is_needed)
        for row, j in torch.nonzero(is_needed).tolist():
            pairs_of_term.setdefault(forcing.terms[j].expression, []).append((row, j))
        self.programs = [Program([expr]) for expr in pairs_of_term]
        self.sizes = [len(pairs) for pairs in pairs_of_term.values()]
        all_pairs = [pair for pairs in pairs_of_term.values() for pair in pairs]
        device = forcing.coefficients.device
        self.rows = torch.tensor([row for row, _ in all_pairs], device=device, dtype=torch.long)
        equations = [fields.index(forcing.terms[j].equation) for _, j in all_pairs]
        slots = [f * self.batch + row for f, (row, _) in zip(equations, all_pairs, strict=True)]
        self.slots = torch.tensor(slots, device=device, dtype=torch.long)
        columns = torch.tensor([j for _, j in all_pairs], device=device, dtype=torch.long)
        weights = forcing.coefficients[self.rows, columns]
        self.weights = weights.reshape(-1, *(1,) * len(operators.grid.shape))

    def __call__(self, values: Mapping[str, Value]) -> list[Value]:
        """Return the forcing of each field, given the values of :meth:`System.values`."""
        if not self.programs:
            return [Value(0.0) for _ in self.fields]
        gathered = [_split(values[name], self.rows, self.sizes) for name in self.fields]
        on_grid: list[Tensor] = []
        for slices, program, size in zip(
            zip(*gathered, strict=True), self.programs, self.sizes, strict=True
        ):
            rows = dict(zip(self.fields, slices, strict=True))
            [value] = program({**values, **rows}, self.operators)
            result = torch.as_tensor(self.operators.on_grid(value)).to(self.weights)
            on_grid.append(result.expand(size, *self.operators.grid.shape))
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
