"""A bump in space: where a localised source acts."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.physics.expressions.reflection import side
from dashred.physics.grids.grid import Axis
from dashred.physics.system import System

# Half the width of the region of a bump, in its widths: 95 % of a normal distribution.
REGION_WIDTHS = 1.96
# Relative step of the differences by the unknowns.
STEP = 1e-4


@dataclass(frozen=True)
class Bump:
    """``b(x) = Π_a exp(κ_a (cos(2π (x_a - c_a)/P_a) - 1))`` with ``κ_a = (P_a/2πw)²``.

    P is the period of the axis' ring. A narrow bump is ``exp(-|x - c|²/2w²)``. Its peak is 1.

    Attributes:
        centre: c, one coordinate for each axis.
        width: w, the standard deviation along every axis.
    """

    centre: tuple[float, ...]
    width: float

    def on_grid(self, system: System) -> Tensor:
        """Return b on the grid, ``(*grid)``; it is odd at fixed ends, as the fields are."""
        found = torch.ones(system.grid.shape, dtype=torch.float64)
        for axis, centre in zip(system.axes, self.centre, strict=True):
            x = system.grid.coordinates[axis.name]
            turn = 2 * math.pi / axis.period * (x - centre)
            found = found * torch.exp(self._steepness(axis) * (torch.cos(turn) - 1))
            if axis.ends == "fixed":
                found = found * system.grid.sides[side(axis.name)]
        return found

    def at(self, places: Tensor, system: System) -> Tensor:
        """Return b at some places ``(place, axis)``, ``(place,)``."""
        total = torch.zeros(len(places), dtype=torch.float64)
        for index, (axis, centre) in enumerate(zip(system.axes, self.centre, strict=True)):
            turn = 2 * math.pi / axis.period * (places[:, index] - centre)
            total += self._steepness(axis) * (torch.cos(turn) - 1)
        return total.exp()

    def text(self, system: System) -> str:
        """Return b in the equation language."""
        parts = []
        for axis, centre in zip(system.axes, self.centre, strict=True):
            turn = f"{2 * math.pi / axis.period:.6g}*({axis.name} - {centre:.6g})"
            parts.append(f"{self._steepness(axis):.6g}*(cos({turn}) - 1)")
        return f"exp({' + '.join(parts)})"

    def slopes(self, system: System) -> list[Tensor]:
        """Return the derivatives of b by every coordinate of c and by ln w, each ``(*grid)``."""
        size = [STEP * self.width] * len(self.centre) + [STEP]
        found = []
        for index, step in enumerate(size):
            move = [0.0] * len(size)
            move[index] = step
            ahead = self.moved(move).on_grid(system)
            behind = self.moved([-value for value in move]).on_grid(system)
            found.append((ahead - behind) / (2 * step))
        return found

    def moved(self, move: list[float]) -> Bump:
        """Return the bump with its centre and ln w moved."""
        centre = tuple(c + m for c, m in zip(self.centre, move[:-1], strict=True))
        return replace(self, centre=centre, width=self.width * math.exp(move[-1]))

    def within(self, system: System) -> Bump:
        """Return the bump with its centre in the domain."""
        return replace(self, centre=system.grid.wrap(self.centre))

    def integral(self, system: System) -> float:
        """Return ``∫ b dx`` over the domain."""
        return system.grid.volume(self.on_grid(system).abs())

    def region(self, axis: Axis, index: int) -> tuple[float, float]:
        """Return from where to where the bump acts along an axis; it may wrap around a ring."""
        centre, half = self.centre[index], REGION_WIDTHS * self.width
        return axis.interval(centre - half, centre + half)

    def _steepness(self, axis: Axis) -> float:
        return (axis.period / (2 * math.pi * self.width)) ** 2
