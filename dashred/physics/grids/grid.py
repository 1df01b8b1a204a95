"""Uniform grids, and their wavenumbers: of rings, on which an axis with ends has its image."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from dashred.physics.expressions.reflection import side


@dataclass(frozen=True)
class Axis:
    """One spatial axis: points at ``j·length/points`` from 0 on.

    A periodic axis is a ring itself. One with ends is half of a ring, of which the other half is
    its mirror image (:mod:`dashred.physics.expressions.reflection`): point ``2·points - j`` that of
    point j.

    Attributes:
        name: its coordinate.
        length: from end to end, or around.
        points: so many spacings make up the length.
        ends: ``periodic``, ``insulated`` or ``fixed``.
    """

    name: str
    length: float
    points: int
    ends: str = "periodic"

    @property
    def spacing(self) -> float:
        """Distance between neighbouring points, in the axis' unit."""
        return self.length / self.points

    @property
    def periodic(self) -> bool:
        """Whether it is a ring itself."""
        return self.ends == "periodic"

    @property
    def around(self) -> int:
        """Points of the ring."""
        return self.points if self.periodic else 2 * self.points

    @property
    def period(self) -> float:
        """Length of the ring."""
        return self.length if self.periodic else 2 * self.length

    @property
    def own_points(self) -> int:
        """How many of the ring's points are the axis' own, both ends among them."""
        return self.points if self.periodic else self.points + 1

    @property
    def own(self) -> slice:
        """The ring's points that are the axis' own."""
        return slice(self.own_points)

    def inside(self, place: float) -> float:
        """Return a place on the axis: around it, or mirrored at an end."""
        if self.periodic:
            return place % self.length
        return self.length - abs(place % self.period - self.length)


@dataclass(frozen=True)
class Grid:
    """The product of the axes; ``Grid(())`` is the single point of an ODE system."""

    axes: tuple[Axis, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """Points around each axis' ring."""
        return tuple(axis.around for axis in self.axes)

    @property
    def dims(self) -> tuple[int, ...]:
        """The trailing tensor dimensions that are space: ``(-2, -1)`` for two axes."""
        return tuple(range(-len(self.axes), 0))

    @property
    def own_coordinates(self) -> dict[str, Tensor]:
        """Coordinates along each axis, ``(point,)``, float64, without mirror images."""
        flat = zip(self.axes, self.coordinates.items(), strict=True)
        return {name: x.flatten()[axis.own] for axis, (name, x) in flat}

    def index(self, axis: str) -> int:
        """Position of the named axis among the axes."""
        return [a.name for a in self.axes].index(axis)

    def refined(self, factor: int) -> Grid:
        """Return the grid with ``factor`` times the points on every axis."""
        return Grid(tuple(replace(a, points=a.points * factor) for a in self.axes))

    @cached_property
    def coordinates(self) -> dict[str, Tensor]:
        """Coordinate of every point, broadcastable over the grid, float64; an image has its own."""
        found = {}
        for index, axis in enumerate(self.axes):
            around = torch.arange(axis.around, dtype=torch.float64)
            points = around if axis.periodic else torch.minimum(around, axis.around - around)
            found[axis.name] = (points * axis.spacing).reshape(self._broadcast(index))
        return found

    @cached_property
    def sides(self) -> dict[str, Tensor]:
        """Side of the ring of every axis with ends, by name: 1, on the image -1, at the ends 0."""
        found = {}
        for index, axis in enumerate(self.axes):
            if not axis.periodic:
                around = torch.arange(axis.around)
                signs = torch.sign(axis.points - around) * torch.sign(around)
                found[side(axis.name)] = signs.double().reshape(self._broadcast(index))
        return found

    @property
    def places(self) -> dict[str, Tensor]:
        """All that expressions read of a place, by name: coordinates and sides."""
        return self.coordinates | self.sides

    def own(self, states: Tensor) -> Tensor:
        """Return states ``(…, *grid)`` without the mirror images beyond ends."""
        for dim, axis in zip(self.dims, self.axes, strict=True):
            states = states.narrow(dim, 0, axis.own.stop)
        return states

    def ring(self, states: Tensor) -> Tensor:
        """Return fields ``(…, *grid)`` that :meth:`own` has cropped with their mirror images."""
        for dim, axis in zip(self.dims, self.axes, strict=True):
            if not axis.periodic:
                image = states.narrow(dim, 1, axis.points - 1).flip(dim)
                sign = 1.0 if axis.ends == "insulated" else -1.0
                states = torch.cat([states, sign * image], dim=dim)
        return states

    @cached_property
    def wavenumbers(self) -> tuple[Tensor, ...]:
        """Angular wavenumbers k of each axis in ``rfftn`` layout, broadcastable, float64."""
        found = []
        for index, axis in enumerate(self.axes):
            last = index == len(self.axes) - 1
            frequencies = torch.fft.rfftfreq if last else torch.fft.fftfreq
            k = frequencies(axis.around, d=axis.spacing, dtype=torch.float64) * 2 * math.pi
            found.append(k.reshape(self._broadcast(index)))
        return tuple(found)

    def interpolate(self, states: Tensor, finer: Grid) -> Tensor:
        """Band-limited interpolation of ``(…, *grid)`` to ``(…, *finer.grid)``, exact at nodes."""
        for dim, axis, target in zip(self.dims, self.axes, finer.axes, strict=True):
            states = _resample(states, dim, axis.around, target.around)
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
