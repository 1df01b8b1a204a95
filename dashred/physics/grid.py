"""Uniform grids on periodic axes, and their wavenumbers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor


@dataclass(frozen=True)
class Axis:
    """One periodic spatial axis: points at ``j·length/points``, j = 0 … points-1."""

    name: str
    length: float
    points: int

    @property
    def spacing(self) -> float:
        """Distance between neighbouring points, in the axis' unit."""
        return self.length / self.points


@dataclass(frozen=True)
class Grid:
    """The product of the axes; ``Grid(())`` is the single point of an ODE system."""

    axes: tuple[Axis, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """Points along each axis."""
        return tuple(axis.points for axis in self.axes)

    @property
    def dims(self) -> tuple[int, ...]:
        """The trailing tensor dimensions that are space: ``(-2, -1)`` for two axes."""
        return tuple(range(-len(self.axes), 0))

    def index(self, axis: str) -> int:
        """Position of the named axis among the axes."""
        return [a.name for a in self.axes].index(axis)

    def refined(self, factor: int) -> Grid:
        """Return the grid with ``factor`` times the points on every axis."""
        return Grid(tuple(Axis(a.name, a.length, a.points * factor) for a in self.axes))

    @cached_property
    def coordinates(self) -> dict[str, Tensor]:
        """Coordinate of every point, broadcastable over the grid, float64."""
        found = {}
        for index, axis in enumerate(self.axes):
            points = torch.arange(axis.points, dtype=torch.float64) * axis.spacing
            found[axis.name] = points.reshape(self._broadcast(index))
        return found

    @cached_property
    def wavenumbers(self) -> tuple[Tensor, ...]:
        """Angular wavenumbers k of each axis in ``rfftn`` layout, broadcastable, float64."""
        found = []
        for index, axis in enumerate(self.axes):
            last = index == len(self.axes) - 1
            frequencies = torch.fft.rfftfreq if last else torch.fft.fftfreq
            k = frequencies(axis.points, d=axis.spacing, dtype=torch.float64) * 2 * math.pi
            found.append(k.reshape(self._broadcast(index)))
        return tuple(found)

    def interpolate(self, states: Tensor, finer: Grid) -> Tensor:
        """Band-limited interpolation of ``(…, *grid)`` to ``(…, *finer.grid)``, exact at nodes."""
        for dim, axis, target in zip(self.dims, self.axes, finer.axes, strict=True):
            states = _resample(states, dim, axis.points, target.points)
        return states

    def _broadcast(self, index: int) -> tuple[int, ...]:
        return tuple(-1 if i == index else 1 for i in range(len(self.axes)))


def _resample(values: Tensor, dim: int, points: int, target: int) -> Tensor:
    spectrum = torch.fft.rfft(values, dim=dim)
    if points % 2 == 0 and target > points:
        # The Nyquist mode stands for both ±N/2, of which a finer grid keeps one apart.
        nyquist = spectrum.narrow(dim, points // 2, 1)
        spectrum = torch.cat((spectrum.narrow(dim, 0, points // 2), nyquist / 2), dim=dim)
    return torch.fft.irfft(spectrum, n=target, dim=dim) * (target / points)
