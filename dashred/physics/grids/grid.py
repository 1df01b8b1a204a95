"""Uniform grids; an axis with equal ends is extended to a ring by its mirror image."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import torch
from torch import Tensor

from dashred.physics.expressions.reflection import side
from dashred.physics.grids.cell_interpolation import cell_weights


@dataclass(frozen=True)
class Axis:
    """One spatial axis with points at ``j·length/points``, starting at 0.

    A periodic axis is a ring. An axis with ends is one half of a ring; the other half is its
    mirror image (:mod:`dashred.physics.expressions.reflection`), where point ``2·points - j`` is
    the image of point j. A staggered axis, which has a condition for each side, has no image: the
    centres of its cells are at odd points and their faces at even points
    (:mod:`dashred.physics.grids.staggered`).

    An open axis is a coordinate of scattered nodes (:mod:`dashred.physics.grids.mesh`).

    Attributes:
        name: of the coordinate.
        length: from end to end, or once around the ring.
        points: number of grid steps in the length; of cells, if staggered.
        ends: ``periodic``, ``insulated``, ``fixed``, ``staggered`` or ``open``.
        radial: whether the coordinate is the distance from the axis of a cylinder.
        begin: the smallest coordinate; other than 0 for an open axis only.
    """

    name: str
    length: float
    points: int
    ends: str = "periodic"
    radial: bool = False
    begin: float = 0.0

    @property
    def spacing(self) -> float:
        """Distance between neighbouring points, in the axis' unit."""
        return self.length / (2 * self.points if self.staggered else self.points)

    @property
    def periodic(self) -> bool:
        """Whether the axis is periodic."""
        return self.ends == "periodic"

    @property
    def staggered(self) -> bool:
        """Whether its points are cells and faces, without a mirror image."""
        return self.ends == "staggered"

    @property
    def mirrored(self) -> bool:
        """Whether the ring contains a mirror image."""
        return self.ends in ("insulated", "fixed")

    @property
    def ring_points(self) -> int:
        """Number of points on the ring; of a staggered axis, on the axis."""
        if self.staggered:
            return 2 * self.points + 1
        return self.points if self.periodic else 2 * self.points

    @property
    def period(self) -> float:
        """Length of the ring."""
        return self.length if self.periodic else 2 * self.length

    @property
    def own_points(self) -> int:
        """Number of points on the axis itself, including both ends but not the mirror image."""
        return self.points + 1 if self.mirrored else self.ring_points

    @property
    def own(self) -> slice:
        """Slice of the ring's points that are on the axis itself."""
        return slice(self.own_points)

    def wrap(self, place: float) -> float:
        """Map a coordinate onto the axis: wrapped if periodic, else mirrored at an end."""
        if self.periodic:
            return place % self.length
        if self.ends == "open":
            return min(max(place, self.begin), self.begin + self.length)
        return self.length - abs(place % self.period - self.length)

    def interval(self, begin: float, end: float) -> tuple[float, float]:
        """Return the ends of an interval as coordinates of the axis, from 0 to its length.

        On a periodic axis, an interval that crosses the end of the axis has ``begin > end``: it
        consists of the coordinates above ``begin`` and those below ``end``. On an axis with ends,
        the interval is cut off at the ends.
        """
        if self.periodic and end - begin >= self.length:
            return 0.0, self.length
        if self.periodic:
            return begin % self.length, self.length - (-end) % self.length
        if self.ends == "open":
            return self.wrap(begin), self.wrap(end)
        turns = self.period * math.floor(((begin + end) / 2 + self.length) / self.period)
        ends = (begin - turns, end - turns)
        return min(max(ends[0], 0.0), self.length), min(max(ends[1], 0.0), self.length)


class HasAxes(Protocol):
    """A grid, of whatever kind."""

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The axes."""


@dataclass(frozen=True)
class Grid:
    """The product of the axes; ``Grid(())`` is the single point of an ODE system."""

    axes: tuple[Axis, ...]

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Number of points on the ring of each axis."""
        return tuple(axis.ring_points for axis in self.axes)

    @cached_property
    def dims(self) -> tuple[int, ...]:
        """Spatial dimensions of a tensor, counted from the end: ``(-2, -1)`` for two axes."""
        return tuple(range(-len(self.axes), 0))

    @property
    def own_coordinates(self) -> dict[str, Tensor]:
        """Coordinates along each axis, ``(point,)``, float64, without mirror images."""
        flat = zip(self.axes, self.coordinates.items(), strict=True)
        return {name: x.flatten()[axis.own] for axis, (name, x) in flat}

    @property
    def dimensions(self) -> tuple[str, ...]:
        """Names of the dimensions of a field without mirror images."""
        return tuple(axis.name for axis in self.axes)

    @property
    def files(self) -> tuple[str, ...]:
        """Hashes of the files that it comes from: none."""
        return ()

    @property
    def labels(self) -> dict[str, tuple[str, Tensor]]:
        """Dimension and values of each coordinate in a dataset, ``(point,)``."""
        return {name: (name, x) for name, x in self.own_coordinates.items()}

    def index(self, axis: str) -> int:
        """Return the index of an axis by name."""
        return [a.name for a in self.axes].index(axis)

    def refined(self, factor: int) -> Grid:
        """Return the grid with ``factor`` times the points on every axis."""
        return Grid(tuple(replace(a, points=a.points * factor) for a in self.axes))

    @cached_property
    def coordinates(self) -> dict[str, Tensor]:
        """Coordinate of every ring point, broadcastable over the grid, float64.

        A point of the mirror image has the coordinate of its original.
        """
        found = {}
        for index, axis in enumerate(self.axes):
            ring = torch.arange(axis.ring_points, dtype=torch.float64)
            points = torch.minimum(ring, axis.ring_points - ring) if axis.mirrored else ring
            found[axis.name] = (points * axis.spacing).reshape(self._broadcast(index))
        return found

    @cached_property
    def sides(self) -> dict[str, Tensor]:
        """Side of every axis with ends, by name: 1 on the axis, -1 on the image, 0 at the ends."""
        found = {}
        for index, axis in enumerate(self.axes):
            if axis.mirrored:
                ring = torch.arange(axis.ring_points)
                signs = torch.sign(axis.points - ring) * torch.sign(ring)
                found[side(axis.name)] = signs.double().reshape(self._broadcast(index))
        return found

    @property
    def places(self) -> dict[str, Tensor]:
        """Coordinates and sides by name, as used in expressions."""
        return self.coordinates | self.sides

    def contains(self, place: Sequence[float]) -> bool:
        """Return whether a place, whose coordinates are on the axes, is in the domain: it is."""
        return True

    def wrap(self, place: Sequence[float]) -> tuple[float, ...]:
        """Map a place into the domain, axis by axis."""
        return tuple(axis.wrap(x) for axis, x in zip(self.axes, place, strict=True))

    def volume(self, field: Tensor) -> float:
        """Return ``Σ f V`` over the points of one field, ``(*grid)``, with the volume V of each.

        Mirror images are not part of the domain.
        """
        spacing = math.prod(axis.spacing for axis in self.axes)
        images = 2 ** sum(axis.mirrored for axis in self.axes)
        return float(field.sum()) * spacing / images

    def picture(self, states: Tensor) -> tuple[dict[str, Tensor], Tensor]:
        """Return the coordinates along each axis, and states ``(…, *points)`` to draw there."""
        return self.own_coordinates, self.own(states)

    def own(self, states: Tensor) -> Tensor:
        """Return states ``(…, *grid)`` without their mirror images."""
        for dim, axis in zip(self.dims, self.axes, strict=True):
            states = states.narrow(dim, 0, axis.own.stop)
        return states

    def ring(self, states: Tensor) -> Tensor:
        """Extend fields that :meth:`own` has cropped by their mirror images, ``(…, *grid)``."""
        for dim, axis in zip(self.dims, self.axes, strict=True):
            if axis.mirrored:
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
            k = frequencies(axis.ring_points, d=axis.spacing, dtype=torch.float64) * 2 * math.pi
            found.append(k.reshape(self._broadcast(index)))
        return tuple(found)

    def interpolate(self, states: Tensor, finer: HasAxes) -> Tensor:
        """Return the interpolation of ``(…, *grid)`` to ``(…, *finer.grid)``.

        It is band-limited on rings, and cubic on a staggered axis.
        """
        for dim, axis, target in zip(self.dims, self.axes, finer.axes, strict=True):
            if axis.staggered:
                places = torch.arange(target.ring_points, dtype=torch.float64) * target.spacing
                states = states @ cell_weights(axis, places).T
            else:
                states = _resample(states, dim, axis.ring_points, target.ring_points)
        return states

    def _broadcast(self, index: int) -> tuple[int, ...]:
        return tuple(-1 if i == index else 1 for i in range(len(self.axes)))


def _resample(values: Tensor, dim: int, points: int, target: int) -> Tensor:
    spectrum = torch.fft.rfft(values, dim=dim)
    if points % 2 == 0 and target > points:
        # The Nyquist mode represents both ±N/2; on a finer grid each gets one half.
        nyquist = spectrum.narrow(dim, points // 2, 1)
        spectrum = torch.cat((spectrum.narrow(dim, 0, points // 2), nyquist / 2), dim=dim)
    return torch.fft.irfft(spectrum, n=target, dim=dim) * (target / points)
