"""Intermediate values of a computation: fields on the grid, in Fourier modes, or both."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from dashred.physics.grids.grid import Grid
from dashred.physics.grids.mesh import Mesh


class Part:
    """One summand of a :class:`Value`, in all forms that are known.

    Attributes:
        points: on the grid, ``(…, *grid)`` or a number.
        modes: in Fourier modes, ``(…, *modes)``.
        source: ``(points, symbol)`` if the modes are ``symbol·FFT(points)``, computed on demand.
    """

    __slots__ = ("modes", "points", "source")

    def __init__(
        self,
        points: Tensor | float | None = None,
        modes: Tensor | None = None,
        source: tuple[Tensor, Tensor] | None = None,
    ) -> None:
        self.points, self.modes, self.source = points, modes, source


class Value:
    """A field as a weighted sum of parts.

    Linear operators and sums use the available form; only products transform, so that an equation
    needs the fewest possible FFTs.
    """

    __slots__ = ("parts",)

    def __init__(self, points: Tensor | float | None = None, modes: Tensor | None = None) -> None:
        self.parts: list[tuple[float, Part]] = [(1.0, Part(points, modes))]

    def scaled(self, factor: float) -> Value:
        """Return ``factor`` times the field."""
        return of_parts([(factor * weight, part) for weight, part in self.parts])


def of_parts(parts: list[tuple[float, Part]]) -> Value:
    """Return the sum of weighted parts."""
    value = Value.__new__(Value)
    value.parts = parts
    return value


def total(values: Sequence[Value]) -> Value:
    """Return the sum."""
    return of_parts([weighted for value in values for weighted in value.parts])


def combine(weighted: Sequence[tuple[float, Tensor | float]]) -> Tensor | float:
    """Return ``Σ cᵢ fᵢ`` with the fewest operations, which dominate the cost on small grids."""
    (weight, first), *rest = weighted
    found = first if weight == 1.0 else weight * first
    for c, f in rest:
        if c == 1.0:
            found = found + f
        elif c == -1.0:
            found = found - f
        elif isinstance(found, Tensor) and isinstance(f, Tensor):
            found = torch.add(found, f, alpha=c)
        else:
            found = found + c * f
    return found


def on_points(value: Value) -> Tensor | float:
    """Return the field on the grid; every part must be known on the grid."""
    return combine([(c, part.points) for c, part in value.parts if part.points is not None])


def on_whole_grid(points: Tensor | float, grid: Grid | Mesh) -> Tensor:
    """Expand a number, a coordinate or a field to ``(…, *grid)``."""
    field = torch.as_tensor(points, dtype=torch.float64)
    rank = len(grid.shape)
    if field.shape[-rank:] == grid.shape:
        return field
    batch = field.shape[:-rank] if field.dim() > rank else ()
    return field.expand(*batch, *grid.shape)
