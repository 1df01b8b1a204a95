"""Basis of a free forcing: functions of space times functions of time, for every equation."""

from __future__ import annotations

import math
from collections.abc import Sequence
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
    """``f_e(x, t) = Σ_ck a_eck b_c(x) h_k(t)``: bumps b in space, courses h in time.

    The courses are linear between the knots. Those of :meth:`over` are hat functions, one for each
    knot. Its bumps are a partition of unity, and so are the hat functions between the first and the
    last knot: equal amplitudes give a constant forcing.

    Attributes:
        bumps: b on the grid, ``(cell, *grid)``.
        knots: times between which the courses are linear, ``(knot,)``.
        courses: h at the knots, ``(knot, course)``.
        fields: number of forced equations.
        mesh: number of cells along each axis, if the bumps are those of :meth:`over`.
    """

    bumps: Tensor
    knots: Tensor
    courses: Tensor
    fields: int
    mesh: tuple[int, ...] = ()

    @classmethod
    def over(cls, system: System, times: Tensor, cells: int, knots: int) -> ForcingBasis:
        """Return a basis that covers the domain and a time interval.

        Args:
            system: with the grid.
            times: the earliest and the latest are the first and the last knot.
            cells: number of cells along every axis if these are equally long, see
                :func:`square_mesh`.
            knots: number of knots in time.
        """
        mesh = square_mesh([axis.length for axis in system.axes], cells)
        bumps = torch.ones((1, *system.grid.shape), dtype=torch.float64)
        coordinates, sides = system.grid.coordinates, system.grid.sides
        for axis, count in zip(system.axes, mesh, strict=True):
            x = coordinates[axis.name]
            along = torch.stack([_bump(axis, x, j, count) for j in range(count)])
            along = along / along.sum(dim=0)
            if axis.ends == "fixed":
                along = along * sides[side(axis.name)]
            bumps = (bumps[:, None] * along[None]).flatten(0, 1)
        peaks = knots_over(times, knots)
        hats = torch.eye(knots, dtype=torch.float64)
        return cls(bumps, peaks, hats, len(system.fields), mesh)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the amplitudes, ``(equation, cell, course)``."""
        return self.fields, len(self.bumps), self.courses.shape[1]

    @property
    def is_nodal(self) -> bool:
        """Whether the courses are hat functions, one for each knot."""
        return torch.equal(self.courses, torch.eye(len(self.knots), dtype=torch.float64))

    @property
    def count(self) -> int:
        """Number of amplitudes."""
        return math.prod(self.shape)

    def hats(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return h at the given times, ``(time, course)``."""
        rows = [np.interp(times, self.knots.numpy(), row) for row in self.courses.T.numpy()]
        return np.stack(rows, axis=-1)

    def at_knots(self, amplitudes: Tensor) -> Tensor:
        """Return the forcing on the grid at every knot, ``(…, knot, equation, *grid)``.

        Args:
            amplitudes: a, ``(…, equation, cell, course)``.
        """
        flat = self.bumps.reshape(len(self.bumps), -1)
        at_knots = amplitudes @ self.courses.T
        found = torch.einsum("...eck,cx->...kex", at_knots, flat)
        return found.reshape(*found.shape[:-1], *self.bumps.shape[1:])

    def sampled_forcing(self, amplitudes: Tensor) -> SampledForcing:
        """Return the forcing of many trajectories, ``(row, equation, cell, course)``."""
        return SampledForcing(self.knots, self.at_knots(amplitudes))


@dataclass(frozen=True)
class SampledForcing:
    """A forcing ``f(x, t)`` of every trajectory, piecewise linear in time.

    Attributes:
        knots: times, ``(knot,)``; the forcing is constant before the first and after the last.
        values: at the knots, ``(row, knot, equation, *grid)``.
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

    def to(self, device: torch.device) -> SampledForcing:
        """Return the forcing with its values on a device."""
        return replace(self, values=self.values.to(device))

    def row(self, i: int) -> SampledForcing:
        """Return the forcing of one trajectory."""
        return replace(self, values=self.values[i : i + 1])

    def rows(self, chosen: Tensor) -> SampledForcing:
        """Return the forcing of the chosen trajectories, ``(row,)``."""
        return replace(self, values=self.values[chosen])


def knots_over(times: Tensor, count: int) -> Tensor:
    """Return evenly spaced knots from the earliest to the latest time, ``(knot,)``."""
    ends = float(times.min()), float(times.max())
    return torch.linspace(*ends, count, dtype=torch.float64)


def square_mesh(lengths: Sequence[float], cells: int) -> tuple[int, ...]:
    """Return the numbers of cells along axes, whose cells have about equal sides.

    There are about ``cells`` to the power of the number of axes in all: with cells as long as the
    domain is, a source in a long channel would be narrower than every cell.

    Args:
        lengths: of the axes.
        cells: number of cells along every axis if they are equally long.
    """
    total, volume = float(cells ** len(lengths)), math.prod(lengths)
    found = [1] * len(lengths)
    # The shortest axis first: the others share what it does not take.
    for rank, index in enumerate(sorted(range(len(lengths)), key=lambda i: lengths[i])):
        side = (volume / total) ** (1 / (len(lengths) - rank))
        found[index] = max(1, round(lengths[index] / side))
        total, volume = total / found[index], volume / lengths[index]
    return tuple(found)


def cell_centres(system: System, mesh: Sequence[int]) -> Tensor:
    """Return the centres of the cells of a mesh in the order of the basis, ``(cell, axis)``."""
    if not system.axes:
        return torch.zeros((1, 0), dtype=torch.float64)
    centres = [
        (torch.arange(count, dtype=torch.float64) + 0.5) * axis.length / count + axis.begin
        for axis, count in zip(system.axes, mesh, strict=True)
    ]
    return torch.stack(torch.meshgrid(*centres, indexing="ij"), dim=-1).flatten(0, -2)


def _bump(axis: Axis, x: Tensor, cell: int, cells: int) -> Tensor:
    """Return a periodic bump around the centre of a cell, as wide as the cell."""
    width = axis.length / cells
    turn = 2 * math.pi * (x - axis.begin - (cell + 0.5) * width) / axis.period
    return torch.exp((torch.cos(turn) - 1) * (axis.period / width / math.pi) ** 2)
