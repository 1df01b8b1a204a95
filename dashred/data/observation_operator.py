"""The observation operator H: maps the state of a system to sensor values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from dashred.data.interpolation import interpolation_weights
from dashred.data.sensors import ObservedAxis, Sensor, SystemDescription, check_sensor
from dashred.physics.backends.input_signals import Array
from dashred.physics.grids.grid import Grid
from dashred.physics.grids.mesh import Mesh


@runtime_checkable
class ObservedSystem(SystemDescription, Protocol):
    """The part of a system that the observation operator needs."""

    @property
    def grid(self) -> Grid | Mesh:
        """The points of a field."""

    @property
    def spectral(self) -> bool:
        """Whether the fields are band-limited rather than known at grid points only."""

    def evaluate(self, name: str, state: Tensor, t: float | Array, /) -> Tensor:
        """Return a derived quantity ``(*batch, *grid)`` of states ``(*batch, field, *grid)``."""


class ObservationOperator(nn.Module):
    """``y = H(v)``: evaluate each sensor's quantity on the grid and interpolate it to the sensor.

    Interpolation is trigonometric for spectral systems, linear for finite differences, cubic
    for finite volumes, and by local stencils on scattered nodes. On several axes the weights are
    products of one-dimensional weights.
    A sensor that averages over a region has the mean of the weights there. The operator is
    differentiable and works in the dtype of the state.
    """

    _weights: Tensor
    _order: Tensor

    def __init__(self, sensors: Sequence[Sensor], system: ObservedSystem) -> None:
        """Compute the interpolation weights.

        Raises:
            InputError: a sensor does not fit the system.
        """
        super().__init__()
        for sensor in sensors:
            check_sensor(sensor, system, f"sensor {sensor.name!r}")
        self.sensors = tuple(sensors)
        self._system = system
        # Group the sensors by quantity, so that one matrix product reads each group.
        order = sorted(range(len(sensors)), key=lambda index: sensors[index].reads)
        self._groups = _group_slices([sensors[index].reads for index in order])
        self.register_buffer("_weights", _weights([sensors[i] for i in order], system))
        self.register_buffer("_order", torch.tensor(order, dtype=torch.long).argsort())

    @property
    def rank(self) -> int:
        """Number of dimensions of a field."""
        return len(self._system.grid.shape)

    @property
    def is_linear(self) -> bool:
        """Whether every sensor reads a field, not a derived quantity."""
        return all(sensor.reads in self._system.fields for sensor in self.sensors)

    def forward(
        self, state: Float[Tensor, "*dims"], t: float | Array = 0.0
    ) -> Float[Tensor, "*batch sensor"]:
        """Return the sensor values of states ``(*batch, field, *grid)``.

        The time ``t`` matters only to derived quantities that depend on it. It is one time for all
        states, or the times of the states, ``(*batch)``.
        """
        weights = self._weights.to(state)
        batch = state.shape[: state.ndim - 1 - self.rank]
        found = [state.new_empty((*batch, 0))]
        for reads, first, last in self._groups:
            quantity = self._quantity(reads, state, t).reshape(*batch, weights.shape[1])
            found.append(quantity.to(state.dtype) @ weights[first:last].T)
        return torch.cat(found, dim=-1).index_select(-1, self._order.to(state.device))

    def _quantity(self, name: str, state: Tensor, t: float | Array) -> Tensor:
        if name in self._system.fields:
            return state.select(-1 - self.rank, self._system.fields.index(name))
        return self._system.evaluate(name, state, t)


def _weights(sensors: Sequence[Sensor], system: ObservedSystem) -> Float[Tensor, "sensor grid"]:
    if isinstance(system.grid, Mesh):
        return _mesh_weights(sensors, system.grid)
    weights = torch.ones(len(sensors), 1, dtype=torch.float64)
    for index, axis in enumerate(system.axes):
        places = torch.tensor([s.position[index] for s in sensors], dtype=torch.float64)
        along = interpolation_weights(axis, places, system.spectral)
        for row, sensor in enumerate(sensors):
            if sensor.widths and sensor.widths[index] > 0:
                inside, shares = _quadrature(axis, sensor.position[index], sensor.widths[index])
                along[row] = shares @ interpolation_weights(axis, inside, system.spectral)
        weights = (weights[:, :, None] * along[:, None, :]).flatten(1)
    return weights


def _mesh_weights(sensors: Sequence[Sensor], mesh: Mesh) -> Float[Tensor, "sensor node"]:
    points = [_region(sensor, mesh) for sensor in sensors]
    if not points:
        return torch.zeros((0, *mesh.shape), dtype=torch.float64)
    weights = mesh.values_at(torch.cat([places for places, _ in points]).numpy())
    parts = weights.split([len(places) for places, _ in points])
    return torch.stack([shares @ part for (_, shares), part in zip(points, parts, strict=True)])


def _region(sensor: Sensor, mesh: Mesh) -> tuple[Tensor, Tensor]:
    """Return the points ``(point, axis)`` that a sensor averages, and their weights."""
    if not sensor.widths:
        return torch.tensor([sensor.position], dtype=torch.float64), torch.ones(1).double()
    along = map(_quadrature, mesh.axes, sensor.position, sensor.widths)
    lines, shares = zip(*along, strict=True)
    every = [torch.stack(torch.meshgrid(*parts, indexing="ij"), -1) for parts in (lines, shares)]
    return every[0].flatten(0, -2), every[1].prod(dim=-1).flatten()


def _quadrature(axis: ObservedAxis, place: float, width: float) -> tuple[Tensor, Tensor]:
    """Return points and weights of the mean over an interval (Gauss–Legendre)."""
    count = 8 + 4 * math.ceil(axis.ring_points * width / axis.period)
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return torch.from_numpy(place + width / 2 * nodes), torch.from_numpy(weights / 2)


def _group_slices(reads: Sequence[str]) -> list[tuple[str, int, int]]:
    return [
        (name, reads.index(name), reads.index(name) + reads.count(name))
        for name in dict.fromkeys(reads)
    ]
