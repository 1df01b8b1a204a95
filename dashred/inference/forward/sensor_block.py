"""The sensors as a block: the observation operator, and errors of sensors as unknowns."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import Protocol

import torch
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor
from dashred.physics.system import System

# How far off a sensor may be, as a share of the axis, over what its readings are differentiated,
# and where it is looked for first: a front is narrower than what a sensor may be off.
MISPLACED, REACH = 0.03, 0.0005
SOUGHT = (0.0, 0.0025, 0.005, 0.01, 0.015, 0.02, 0.03, 0.045)


class SensorErrors(Protocol):
    """Errors of sensors, with unknowns of their own.

    ``stated`` are the readings without errors, ``states`` the states that they are made of.
    """

    @property
    def scales(self) -> Tensor:
        """Prior standard deviation of every unknown, ``(unknown,)``."""

    def apply(self, stated: Tensor, states: Tensor, unknowns: Tensor) -> Tensor:
        """Return the readings with the errors, ``(batch, time, sensor)``."""

    def columns(self, stated: Tensor, states: Tensor, unknowns: Tensor) -> Tensor:
        """Return the derivative of one run's readings, ``(time, sensor, unknown)``."""

    def first_guess(self, states: Tensor, recorded: Tensor, std: Tensor) -> Tensor:
        """Return unknowns near which the readings are linear in them, ``(unknown,)``.

        Args:
            states: of one run, ``(time, episode, field, *grid)``.
            recorded: ``(time, sensor)``; NaN is missing.
            std: of the noise, ``(sensor,)``.
        """


@dataclass(frozen=True)
class OffsetErrors:
    """Offsets of known shape: ``y = H u + Σ_k c_k p_k``, as a bias or a drift.

    Attributes:
        patterns: p, ``(pattern, time, sensor)``, over the whole record.
        scales: prior standard deviation of c, ``(pattern,)``.
    """

    patterns: Tensor
    scales: Tensor

    def apply(self, stated: Tensor, states: Tensor, unknowns: Tensor) -> Tensor:
        """Return the readings with the offsets, ``(batch, time, sensor)``."""
        return stated + torch.tensordot(unknowns, self._cut(stated), dims=1)

    def columns(self, stated: Tensor, states: Tensor, unknowns: Tensor) -> Tensor:
        """Return ``∂y/∂c``, ``(time, sensor, pattern)``."""
        return self._cut(stated).movedim(0, -1)

    def first_guess(self, states: Tensor, recorded: Tensor, std: Tensor) -> Tensor:
        """Return no offset: the readings are linear in c."""
        return torch.zeros_like(self.scales)

    def _cut(self, stated: Tensor) -> Tensor:
        return self.patterns[:, : stated.shape[-2]]


@dataclass(frozen=True)
class PositionErrors:
    """One sensor reads at ``x + δ``, not at its stated place x; the unknowns are δ.

    Attributes:
        sensor: at its stated place.
        indices: its columns among the readings, one for each episode.
        system: whose fields it reads.
    """

    sensor: Sensor
    indices: list[int]
    system: System

    @property
    def scales(self) -> Tensor:
        """Prior standard deviation of δ, ``(axis,)``."""
        return MISPLACED * self._lengths

    def apply(self, stated: Tensor, states: Tensor, unknowns: Tensor) -> Tensor:
        """Return the readings with this sensor at its own place, ``(batch, time, sensor)``."""
        found = stated.clone()
        for row, path, delta in zip(found, states, unknowns, strict=True):
            row[:, self.indices] = self.at(path, delta[None])[..., 0]
        return found

    def columns(self, stated: Tensor, states: Tensor, unknowns: Tensor) -> Tensor:
        """Return ``∂y/∂δ`` by central differences, ``(time, sensor, axis)``."""
        found = stated.new_zeros((*stated.shape, len(unknowns)))
        for axis, step in enumerate(torch.diag(REACH * self._lengths)):
            places = torch.stack([unknowns + step, unknowns - step])
            ahead, behind = self.at(states, places).unbind(-1)
            found[:, self.indices, axis] = (ahead - behind) / (2 * step[axis])
        return found

    def first_guess(self, states: Tensor, recorded: Tensor, std: Tensor) -> Tensor:
        """Return the δ on a grid of places whose readings are nearest to the recorded ones."""
        shares = sorted({sign * share for share in SOUGHT for sign in (-1.0, 1.0)}, key=abs)
        every = list(product(shares, repeat=len(self.system.axes)))
        places = torch.tensor(every, dtype=torch.float64)
        found = self.at(states, places * self._lengths)
        left = (found - recorded[:, self.indices, None]) / std[self.indices[0]]
        misfits = left.nan_to_num().square().sum(dim=(0, 1))
        misfits = misfits + (places / MISPLACED).square().sum(dim=1)
        return places[int(misfits.argmin())] * self._lengths

    def at(self, states: Tensor, deltas: Tensor) -> Tensor:
        """Return what the sensor reads off its stated place, ``(time, episode, place)``.

        Args:
            states: ``(time, episode, field, *grid)``.
            deltas: distances δ, ``(place, axis)``.
        """
        stated = list(zip(self.sensor.position, self.system.axes, strict=True))
        places = [
            tuple(axis.wrap(x + d) for (x, axis), d in zip(stated, delta, strict=True))
            for delta in deltas.tolist()
        ]
        sensors = [replace(self.sensor, position=place) for place in places]
        return _by_episode(ObservationOperator(sensors, self.system), states)

    @property
    def _lengths(self) -> Tensor:
        return torch.tensor([axis.length for axis in self.system.axes], dtype=torch.float64)


@dataclass(frozen=True)
class SensorBlock:
    """What the sensors read of the states of all episodes.

    Attributes:
        operator: H of one episode's sensors.
        episodes: number of episodes; the readings of each follow those of the one before.
        errors: of sensors; None where all read what they should.
    """

    operator: ObservationOperator
    episodes: int = 1
    errors: SensorErrors | None = None

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return len(self.errors.scales) if self.errors else 0

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """The sensor of every column, ``(episode·sensor,)``."""
        return self.operator.sensors * self.episodes

    def columns_of(self, column: int) -> list[int]:
        """Return the columns of the sensor of one column: one in each episode."""
        count = len(self.operator.sensors)
        return [*range(column % count, count * self.episodes, count)]

    def observe(self, states: Tensor) -> Tensor:
        """Return ``H u`` of states ``(…, episode, field, *grid)``, ``(…, episode·sensor)``."""
        return _by_episode(self.operator, states).flatten(-2)

    def read(self, states: Tensor, unknowns: Tensor) -> Tensor:
        """Return what the sensors read, ``(batch, time, episode·sensor)``.

        Args:
            states: ``(batch, time, episode, field, *grid)``.
            unknowns: of the errors, ``(batch, unknown)``.
        """
        stated = self.observe(states)
        return self.errors.apply(stated, states, unknowns) if self.errors else stated

    def columns(self, states: Tensor, unknowns: Tensor) -> Tensor:
        """Return the derivative of one run's readings by the errors, ``(time, sensor, unknown)``.

        Args:
            states: ``(time, episode, field, *grid)``.
            unknowns: of the errors, ``(unknown,)``.
        """
        stated = self.observe(states)
        if self.errors is None:
            return stated.new_zeros((*stated.shape, 0))
        return self.errors.columns(stated, states, unknowns)


def _by_episode(operator: ObservationOperator, states: Tensor) -> Tensor:
    """Return ``H u``, ``(…, time, episode, sensor)``, of ``(…, time, episode, field, *grid)``.

    One axis for time and episode: a product of many small matrices would be slower.
    """
    episode = states.dim() - 2 - operator.axes
    found = operator(states.flatten(episode - 1, episode))
    return found.unflatten(episode - 1, states.shape[episode - 1 : episode + 1])
