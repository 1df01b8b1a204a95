"""The observation operator H: from the state of a system to what its sensors read."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dashred.data.interpolation import linear, trigonometric
from dashred.data.sensors import Described, Sensor, check_sensor


@runtime_checkable
class ObservedSystem(Described, Protocol):
    """What the operator needs of a system."""

    @property
    def spectral(self) -> bool:
        """Whether its fields are band-limited (else: known at the grid's points only)."""

    def evaluate(self, name: str, state: Tensor, t: float, /) -> Tensor:
        """Value (*batch, *grid) of a derived quantity for states (*batch, field, *grid)."""


class ObservationOperator(nn.Module):
    """y = H(v): evaluates what each sensor reads on the grid, then interpolates to its place.

    Trigonometric interpolation for spectral systems, linear for finite differences; weights are
    products of one-dimensional ones. Differentiable, in the dtype of the state.
    """

    _weights: Tensor
    _order: Tensor

    def __init__(self, sensors: Sequence[Sensor], system: ObservedSystem) -> None:
        """Prepare the weights.

        Raises:
            InputError: for a sensor that the system cannot have.
        """
        super().__init__()
        for sensor in sensors:
            check_sensor(sensor, system, f"sensor {sensor.name!r}")
        self.sensors = tuple(sensors)
        self._system = system
        # Sensors of one quantity lie together, so that one product reads them all.
        order = sorted(range(len(sensors)), key=lambda index: sensors[index].reads)
        self._groups = _runs([sensors[index].reads for index in order])
        self.register_buffer("_weights", _weights([sensors[i] for i in order], system))
        self.register_buffer("_order", torch.tensor(order, dtype=torch.long).argsort())

    @property
    def axes(self) -> int:
        """Number of axes of the grid that its states are on."""
        return len(self._system.axes)

    def forward(
        self, state: Float[Tensor, "*dims"], t: float = 0.0
    ) -> Float[Tensor, "*batch sensor"]:
        """Read states (*batch, field, *grid); ``t`` matters only to lets that name it."""
        weights = self._weights.to(state.dtype)
        batch = state.shape[: state.ndim - 1 - len(self._system.axes)]
        found = [state.new_empty((*batch, 0))]
        for reads, first, last in self._groups:
            quantity = self._quantity(reads, state, t).reshape(*batch, weights.shape[1])
            found.append(quantity.to(state.dtype) @ weights[first:last].T)
        return torch.cat(found, dim=-1).index_select(-1, self._order)

    def _quantity(self, name: str, state: Tensor, t: float) -> Tensor:
        if name in self._system.fields:
            return state.select(-1 - len(self._system.axes), self._system.fields.index(name))
        return self._system.evaluate(name, state, t)


def _weights(sensors: Sequence[Sensor], system: ObservedSystem) -> Float[Tensor, "sensor grid"]:
    interpolate = trigonometric if system.spectral else linear
    weights = torch.ones(len(sensors), 1, dtype=torch.float64)
    for index, axis in enumerate(system.axes):
        places = torch.tensor([s.position[index] for s in sensors], dtype=torch.float64)
        along = interpolate(axis, places)
        weights = (weights[:, :, None] * along[:, None, :]).flatten(1)
    return weights


def _runs(reads: Sequence[str]) -> list[tuple[str, int, int]]:
    return [
        (name, reads.index(name), reads.index(name) + reads.count(name))
        for name in dict.fromkeys(reads)
    ]
