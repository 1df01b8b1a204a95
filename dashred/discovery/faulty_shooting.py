"""Shooting with sensors that do not read what they should: an offset in time, or another place."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from dashred.discovery.shooting import Linearisation, Shooting
from dashred.sensing.observation import ObservationOperator


@dataclass(frozen=True)
class OffsetShooting(Shooting):
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
class MovedShooting(Shooting):
    """``(z, ξ, δ) → H_δ S(z, ξ)``: one sensor stands a little off its stated place.

    To second order in the distance, in which a sensor's weights are smooth. The last coefficients
    are δ along every axis.

    Attributes:
        sensor: which.
        reach: a distance over which weights are differentiated, ``(axis,)``.
    """

    sensor: int
    reach: tuple[float, ...]

    def readings(self, z: Tensor, xi: Tensor) -> Tensor:
        """Return what the sensors read, ``(batch, time, sensor)``."""
        split = len(self.candidates)
        states = self.states(z, xi[:, :split])
        found = self.operator(states)
        moved = self._moved(states, xi[:, split:])
        return torch.cat(
            [found[..., : self.sensor], moved[..., None], found[..., self.sensor + 1 :]], dim=-1
        )

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
        middle = self.operator(states)
        found = torch.zeros((*middle.shape, len(self.reach)), dtype=torch.float64)
        for axis, (ahead, behind) in enumerate(self._beside):
            h = self.reach[axis]
            plus, minus = ahead(states)[:, 0], behind(states)[:, 0]
            curve = (plus - 2 * middle[:, self.sensor] + minus) / h**2
            found[:, self.sensor, axis] = (plus - minus) / (2 * h)
            if delta is not None:
                found[:, self.sensor, axis] += delta[axis] * curve
        return found

    def _moved(self, states: Tensor, delta: Tensor) -> Tensor:
        """Return what the sensor reads where it stands, ``(batch, time)``."""
        middle = self.operator(states)[..., self.sensor]
        found = middle
        for axis, (ahead, behind) in enumerate(self._beside):
            h, d = self.reach[axis], delta[:, axis, None]
            plus, minus = ahead(states)[..., 0], behind(states)[..., 0]
            slope, curve = (plus - minus) / (2 * h), (plus - 2 * middle + minus) / h**2
            found = found + d * slope + d.square() / 2 * curve
        return found

    @cached_property
    def _beside(self) -> list[tuple[ObservationOperator, ObservationOperator]]:
        """H of the sensor a little ahead and behind along every axis."""
        sensor, system = self.operator.sensors[self.sensor], self.simulator.system
        found = []
        for k, axis in enumerate(system.axes):
            pair = []
            for sign in (1, -1):
                place = list(sensor.position)
                place[k] = (place[k] + sign * self.reach[k]) % axis.length
                other = replace(sensor, position=tuple(place))
                pair.append(ObservationOperator([other], system))
            found.append((pair[0], pair[1]))
        return found


def _plain(faulty: Shooting) -> Shooting:
    """Return the same with sensors that read what they should."""
    return Shooting(
        faulty.simulator, faulty.start, faulty.candidates, faulty.operator, faulty.times
    )
