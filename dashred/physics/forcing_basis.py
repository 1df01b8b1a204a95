"""A free forcing: unknown in every cell of space, at every knot in time, of every equation."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dashred.physics.expressions.reflection import side
from dashred.physics.grids.grid import Axis
from dashred.physics.system import System


@dataclass(frozen=True)
class ForcingBasis:
    """``f_e(x, t) = Σ_ck a_eck b_c(x) h_k(t)``: bumps b in space, hats h in time.

    The bumps add up to 1 everywhere, and so do the hats between the first and the last knot:
    equal amplitudes are a constant.

    Attributes:
        bumps: b on the grid, ``(cell, *grid)``.
        knots: where the hats have their tops, ``(knot,)``.
        fields: how many equations are forced.
    """

    bumps: Tensor
    knots: Tensor
    fields: int

    @classmethod
    def over(cls, system: System, times: Tensor, cells: int, knots: int) -> ForcingBasis:
        """Return pulses that cover the whole space and time.

        Args:
            system: its grid.
            times: the earliest and the latest are the first and the last knot.
            cells: along every axis.
            knots: in time.
        """
        bumps = torch.ones((1, *system.grid.shape), dtype=torch.float64)
        coordinates, sides = system.grid.coordinates, system.grid.sides
        for axis in system.axes:
            x = coordinates[axis.name]
            along = torch.stack([_bump(axis, x, j, cells) for j in range(cells)])
            along = along / along.sum(dim=0)
            if axis.ends == "fixed":
                along = along * sides[side(axis.name)]
            bumps = (bumps[:, None] * along[None]).flatten(0, 1)
        ends = float(times.min()), float(times.max())
        return cls(bumps, torch.linspace(*ends, knots, dtype=torch.float64), len(system.fields))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Of the amplitudes, ``(equation, cell, knot)``."""
        return self.fields, len(self.bumps), len(self.knots)

    @property
    def count(self) -> int:
        """Unknown amplitudes."""
        return math.prod(self.shape)

    def hats(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return h at some times, ``(time, knot)``."""
        rows = [np.interp(times, self.knots.numpy(), row) for row in np.eye(len(self.knots))]
        return np.stack(rows, axis=-1)

    def at_knots(self, amplitudes: Tensor) -> Tensor:
        """Return the forcing on the grid at every knot, ``(…, knot, equation, *grid)``.

        Args:
            amplitudes: a, ``(…, equation, cell, knot)``.
        """
        flat = self.bumps.reshape(len(self.bumps), -1)
        found = torch.einsum("...eck,cx->...kex", amplitudes, flat)
        return found.reshape(*found.shape[:-1], *self.bumps.shape[1:])

    def sampled_forcing(self, amplitudes: Tensor) -> SampledForcing:
        """Return the forcing of many trajectories, ``(row, equation, cell, knot)``."""
        return SampledForcing(self.knots, self.at_knots(amplitudes))


@dataclass(frozen=True)
class SampledForcing:
    """A forcing ``f(x, t)`` of every trajectory, along straight lines between knots.

    Attributes:
        knots: ``(knot,)``; before the first and after the last the forcing stays what it is there.
        values: ``(row, knot, equation, *grid)``.
    """

    knots: Tensor
    values: Tensor

    def at(self, t: float) -> Tensor:
        """Return the forcing of every trajectory at one time, ``(row, equation, *grid)``."""
        last = len(self.knots) - 2
        k = min(max(int(torch.searchsorted(self.knots, t, right=True)) - 1, 0), last)
        begin, end = float(self.knots[k]), float(self.knots[k + 1])
        share = min(max((t - begin) / (end - begin), 0.0), 1.0)
        return (1 - share) * self.values[:, k] + share * self.values[:, k + 1]

    def row(self, i: int) -> SampledForcing:
        """Return the forcing of one trajectory."""
        return replace(self, values=self.values[i : i + 1])


def _bump(axis: Axis, x: Tensor, cell: int, cells: int) -> Tensor:
    """Return a bump on the axis' ring about the middle of a cell, as wide as the cell."""
    width = axis.length / cells
    turn = 2 * math.pi * (x - (cell + 0.5) * width) / axis.period
    return torch.exp((torch.cos(turn) - 1) * (axis.period / width / math.pi) ** 2)
