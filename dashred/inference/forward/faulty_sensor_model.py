"""Shooting with sensors that do not read what they should: an offset in time, or another place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor
from dashred.inference.forward.forward_model import ForwardModel, Linearisation


@dataclass(frozen=True)
class SensorOffsetModel(ForwardModel):
    """``(z, ξ, c) → H S(z, ξ) + Σ c_k p_k``: a bias, a drift, or any other known pattern.

    Its coefficients are those of the candidates, then the amplitudes c.

    Attributes:
        patterns: p, ``(pattern, time, sensor)``, over the whole record.
    """

    patterns: Tensor

    def readings(self, z: Tensor, xi: Tensor) -> Tensor:
        """Return what the sensors read, ``(batch, time, sensor)``."""
        split = len(self.candidates)
        offsets = torch.tensordot(xi[:, split:], self.patterns[:, : len(self.times)], dims=1)
        return _plain(self).readings(z, xi[:, :split]) + offsets

    def columns(self, states: Tensor) -> Tensor:
        """Return ``∂/∂c`` of the readings, ``(time, sensor, pattern)``, the same for all states."""
        return self.patterns[:, : len(states)].movedim(0, -1)

    def linearise(self, z: Tensor, xi: Tensor, readings: Tensor | None = None) -> Linearisation:
        """Return readings and Jacobian: of the start, of ξ, and of c."""
        split = len(self.candidates)
        point = _plain(self).linearise(z, xi[:split])
        [readings] = self.readings(z[None], xi[None]) if readings is None else [readings]
        columns = self.patterns[:, : len(self.times)].movedim(0, -1)
        by_error = torch.cat([point.by_error, columns.to(point.by_error.dtype)], dim=-1)
        return Linearisation(readings, point.by_start, by_error)


@dataclass(frozen=True)
class MovedSensorModel(ForwardModel):
    """``(z, ξ, δ) → H_δ S(z, ξ)``: one sensor stands a little off its stated place.

    The last coefficients are δ along every axis.

    Attributes:
        sensor: which.
        reach: a distance over which readings are differentiated, ``(axis,)``.
    """

    sensor: int
    reach: tuple[float, ...]

    def readings(self, z: Tensor, xi: Tensor) -> Tensor:
        """Return what the sensors read, ``(batch, time, sensor)``."""
        split = len(self.candidates)
        states = self.states(z, xi[:, :split])
        found = self.operator(states).clone()
        found[..., self.columns_of_sensor] = self._moved(states, xi[:, split:])
        return found

    def linearise(self, z: Tensor, xi: Tensor, readings: Tensor | None = None) -> Linearisation:
        """Return readings and Jacobian: of the start, of ξ, and of δ."""
        split = len(self.candidates)
        point = _plain(self).linearise(z, xi[:split])
        [states] = self.states(z[None], xi[None, :split])
        columns = self.columns(states, xi[split:])
        [readings] = self.readings(z[None], xi[None]) if readings is None else [readings]
        by_error = torch.cat([point.by_error, columns.to(point.by_error.dtype)], dim=-1)
        return Linearisation(readings, point.by_start, by_error)

    def columns(self, states: Tensor, delta: Tensor | None = None) -> Tensor:
        """Return ``∂/∂δ`` of the readings at some δ, or at 0: ``(time, sensor, axis)``.

        Args:
            states: ``(time, field, *grid)``.
            delta: δ, ``(axis,)``.
        """
        here = torch.zeros(len(self.reach), dtype=torch.float64) if delta is None else delta
        sensors = len(self.operator.sensors)
        found = torch.zeros((len(states), sensors, len(self.reach)), dtype=torch.float64)
        own = self.columns_of_sensor
        for axis, h in enumerate(self.reach):
            step = torch.zeros_like(here)
            step[axis] = h
            ahead, behind = self.at(states, torch.stack([here + step, here - step])).unbind(-1)
            slope = (ahead - behind) / (2 * h)
            found[:, own, axis] = slope.reshape(len(states), len(own))
        return found

    @property
    def columns_of_sensor(self) -> list[int]:
        """Where its readings stand among all."""
        return columns_of(self.operator.sensors, self.sensor)

    def at(self, states: Tensor, deltas: Tensor) -> Tensor:
        """Return what the sensor reads off its stated place, ``(…, time, place)``.

        Args:
            states: ``(…, time, field, *grid)``.
            deltas: distances δ, ``(place, axis)``.
        """
        sensor, system = self.operator.sensors[self.sensor], self.simulator.system
        stated = list(zip(sensor.position, system.axes, strict=True))
        moved = [
            tuple(axis.wrap(x + d) for (x, axis), d in zip(stated, delta, strict=True))
            for delta in deltas.tolist()
        ]
        return ObservationOperator([replace(sensor, position=p) for p in moved], system)(states)

    def _moved(self, states: Tensor, delta: Tensor) -> Tensor:
        """Return what the sensor reads where it stands, ``(batch, time, column)``."""
        read = [self.at(s, d[None])[..., 0] for s, d in zip(states, delta, strict=True)]
        return torch.stack(read).reshape(*states.shape[:2], -1)


def columns_of(sensors: Sequence[Sensor], sensor: int) -> list[int]:
    """Return the columns in which a sensor reads: one in each episode."""
    name = sensors[sensor].name
    return [column for column, other in enumerate(sensors) if other.name == name]


def _plain(faulty: ForwardModel) -> ForwardModel:
    """Return the same with sensors that read what they should."""
    return ForwardModel(
        faulty.simulator, faulty.start, faulty.candidates, faulty.operator, faulty.times
    )
