"""What drives the columns of a sensitivity: terms along a trajectory, many instants at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from dashred.physics.algebra import Expr, add
from dashred.physics.program import Program
from dashred.physics.system import System, Term
from dashred.physics.value import Value, on_whole_grid


class Run(NamedTuple):
    """Neighbouring columns that terms drive in one equation, and the rows of those terms."""

    equation: int
    columns: slice
    rows: slice


class Sources:
    """``Σ_{θ in sources[k]} θ(u)`` of every equation; what drives nothing is left out.

    Args:
        system: names the fields.
        sources: terms of each driven column, lets and parameters resolved.
        first: the first driven column.
    """

    def __init__(self, system: System, sources: Sequence[tuple[Term, ...]], first: int) -> None:
        driven: dict[tuple[int, int], list[Expr]] = {}
        for column, terms in enumerate(sources, first):
            for term in terms:
                place = system.fields.index(term.equation), column
                driven.setdefault(place, []).append(term.expression)
        self.operators = system.operators
        self._places = sorted(driven)
        self._program = Program([add(driven[place]) for place in self._places])

    def __call__(self, values: Mapping[str, Value], instants: int) -> Tensor:
        """Return the terms on the grid, ``(instant, row, *grid)``, float64.

        Args:
            values: of fields, ``(instant, *grid)``, coordinates and time.
            instants: how many there are.
        """
        shape = (instants, *self.operators.grid.shape)
        if not self._places:
            return torch.zeros((instants, 0, *shape[1:]), dtype=torch.float64)
        found = (self.operators.on_grid(v) for v in self._program(values, self.operators))
        rows = [on_whole_grid(f, self.operators.grid).expand(shape) for f in found]
        return torch.stack(rows, dim=1)

    def runs(self, columns: range) -> list[Run]:
        """Return what drives these columns, which are counted from the first of them."""
        found: list[Run] = []
        for row, (equation, column) in enumerate(self._places):
            if column not in columns:
                continue
            at = column - columns.start
            begin, top = at, row
            if found and (found[-1].equation, found[-1].columns.stop) == (equation, at):
                last = found.pop()
                begin, top = last.columns.start, last.rows.start
            found.append(Run(equation, slice(begin, at + 1), slice(top, row + 1)))
        return found
