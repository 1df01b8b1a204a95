"""Interpolation of a field that is known at the centres of cells."""

from __future__ import annotations

from typing import Protocol

import torch
from torch import Tensor

STENCIL = 4


class CellAxis(Protocol):
    """The part of a staggered axis that an interpolation needs."""

    @property
    def length(self) -> float:
        """Extent of the axis, in its own unit."""

    @property
    def points(self) -> int:
        """Number of cells, at least four."""


def cell_weights(axis: CellAxis, positions: Tensor) -> Tensor:
    """Return the weights of the cubic polynomial through the four nearest cells.

    The weights of the faces are zero. The error is of fourth order in the size of the cells.

    Args:
        axis: a staggered axis.
        positions: in the unit of the axis, ``(place,)``.

    Returns:
        ``(place, point)``, with the cells at odd points.
    """
    cells = axis.points
    places = positions / axis.length * cells - 0.5
    first = (torch.floor(places) - 1).clamp(0, cells - STENCIL).long()
    nodes = first[:, None] + torch.arange(STENCIL)
    weights = torch.zeros(len(positions), 2 * cells + 1, dtype=torch.float64)
    for i in range(STENCIL):
        others = [j for j in range(STENCIL) if j != i]
        factors = [(places - nodes[:, j]) / (i - j) for j in others]
        weights[torch.arange(len(positions)), 2 * nodes[:, i] + 1] = torch.stack(factors).prod(0)
    return weights
