"""The sensors as a block: the observation operator, and sensor errors as unknowns."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import Protocol

import torch
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor
from dashred.inference.forward.read_parameters import ReadParameters
from dashred.physics.system import System

# As shares of the axis length: the prior std of a position error, the step of its finite
# difference, and the trial errors for a first guess. A front may be narrower than the error.
POSITION_STD, POSITION_STEP = 0.03, 0.0005
TRIAL_POSITIONS = (0.0, 0.0025, 0.005, 0.01, 0.015, 0.02, 0.03, 0.045)


class SensorErrors(Protocol):
    """Sensor errors with unknowns of their own.

    ``exact`` are the readings without errors, and ``states`` are the states that they belong to.
    """

    @property
    def scales(self) -> Tensor:
        """Prior standard deviation of every unknown, ``(unknown,)``."""

    def apply(self, exact: Tensor, states: Tensor, unknowns: Tensor) -> Tensor:
        """Return the readings with the errors, ``(batch, time, sensor)``."""

    def columns(self, exact: Tensor, states: Tensor, unknowns: Tensor) -> Tensor:
        """Return the derivative of the readings of one run, ``(time, sensor, unknown)``."""

    def first_guess(self, states: Tensor, recorded: Tensor, std: Tensor) -> Tensor:
        """Return a first guess of the unknowns for a linearised fit, ``(unknown,)``.

        Args:
            states: states of one run, ``(time, episode, field, *grid)``.
            recorded: ``(time, sensor)``; NaN where missing.
            std: std of the noise, ``(sensor,)``.
        """


@dataclass(frozen=True)
class OffsetErrors:
    """Offsets of known shape, as a bias or a drift: ``y = H u + Σ_k c_k p_k``.

    Attributes:
        patterns: p, ``(pattern, time, sensor)``, over the whole record.
        scales: prior standard deviation of c, ``(pattern,)``.
    """

    patterns: Tensor
    scales: Tensor

    def apply(self, exact: Tensor, states: Tensor, unknowns: Tensor) -> Tensor:
        """Return the readings with the offsets, ``(batch, time, sensor)``."""
        return exact + torch.tensordot(unknowns, self._cut(exact), dims=1)

    def columns(self, exact: Tensor, states: Tensor, unknowns: Tensor) -> Tensor:
        """Return ``∂y/∂c``, ``(time, sensor, pattern)``."""
        return self._cut(exact).movedim(0, -1)

    def first_guess(self, states: Tensor, recorded: Tensor, std: Tensor) -> Tensor:
        """Return zero offsets: the readings are linear in c."""
        return torch.zeros_like(self.scales)

    def _cut(self, exact: Tensor) -> Tensor:
        return self.patterns[:, : exact.shape[-2]]


@dataclass(frozen=True)
class PositionErrors:
    """A position error of one sensor: it reads at ``x + δ`` instead of x; the unknowns are δ.

    Attributes:
        sensor: the sensor at its stated position x.
        indices: its columns in the readings, one for each episode.
        system: the system whose fields it reads.
    """

    sensor: Sensor
    indices: list[int]
    system: System

    @property
    def scales(self) -> Tensor:
        """Prior standard deviation of δ, ``(axis,)``."""
        return POSITION_STD * self._lengths

    def apply(self, exact: Tensor, states: Tensor, unknowns: Tensor) -> Tensor:
        """Return the readings with this sensor at ``x + δ``, ``(batch, time, sensor)``."""
        found = exact.clone()
        for row, path, delta in zip(found, states, unknowns, strict=True):
            moved, stated = self.at(path, torch.stack([delta, 0 * delta])).unbind(-1)
            row[:, self.indices] += moved - stated
        return found

    def columns(self, exact: Tensor, states: Tensor, unknowns: Tensor) -> Tensor:
        """Return ``∂y/∂δ`` by central differences, ``(time, sensor, axis)``."""
        found = exact.new_zeros((*exact.shape, len(unknowns)))
        for axis, step in enumerate(torch.diag(POSITION_STEP * self._lengths)):
            places = torch.stack([unknowns + step, unknowns - step])
            ahead, behind = self.at(states, places).unbind(-1)
            found[:, self.indices, axis] = (ahead - behind) / (2 * step[axis])
        return found

    def first_guess(self, states: Tensor, recorded: Tensor, std: Tensor) -> Tensor:
        """Return the δ, on a grid of trial positions, with the least misfit and prior penalty."""
        shares = sorted(
            {sign * share for share in TRIAL_POSITIONS for sign in (-1.0, 1.0)}, key=abs
        )
        every = list(product(shares, repeat=len(self.system.axes)))
        places = torch.tensor(every, dtype=torch.float64)
        found = self.at(states, places * self._lengths)
        left = (found - recorded[:, self.indices, None]) / std[self.indices[0]]
        misfits = left.nan_to_num().square().sum(dim=(0, 1))
        misfits = misfits + (places / POSITION_STD).square().sum(dim=1)
        return places[int(misfits.argmin())] * self._lengths

    def at(self, states: Tensor, deltas: Tensor) -> Tensor:
        """Return the readings of the sensor at ``x + δ``, ``(time, episode, place)``.

        Args:
            states: ``(time, episode, field, *grid)``.
            deltas: position errors δ, ``(place, axis)``.
        """
        stated = self.sensor.position
        places = [
            self.system.grid.wrap([x + d for x, d in zip(stated, delta, strict=True)])
            for delta in deltas.tolist()
        ]
        sensors = [replace(self.sensor, position=place) for place in places]
        return _by_episode(ObservationOperator(sensors, self.system), states)

    @property
    def _lengths(self) -> Tensor:
        return torch.tensor([axis.length for axis in self.system.axes], dtype=torch.float64)


@dataclass(frozen=True)
class SensorBlock:
    """The sensors of all episodes.

    Attributes:
        operator: H of the sensors of one episode.
        episodes: number of episodes; readings are ordered episode after episode.
        errors: errors of different sensors, each with unknowns of its own.
        parameters: uncertain parameters that the sensors depend on; None without any.
    """

    operator: ObservationOperator
    episodes: int = 1
    errors: tuple[SensorErrors, ...] = ()
    parameters: ReadParameters | None = None

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return sum(len(each.scales) for each in self.errors)

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """The sensor of every column, ``(episode·sensor,)``."""
        return self.operator.sensors * self.episodes

    def columns_of(self, column: int) -> list[int]:
        """Return the columns of the same sensor in all episodes."""
        count = len(self.operator.sensors)
        return [*range(column % count, count * self.episodes, count)]

    def observe(self, states: Tensor) -> Tensor:
        """Return ``H u``, ``(…, episode·sensor)``, for states ``(…, episode, field, *grid)``."""
        return _by_episode(self.operator, states).flatten(-2)

    def with_errors(self, exact: Tensor, states: Tensor, unknowns: Tensor) -> Tensor:
        """Return readings with sensor errors, ``(batch, time, episode·sensor)``.

        Args:
            exact: the readings without errors.
            states: ``(batch, time, episode, field, *grid)``.
            unknowns: unknowns of the errors, ``(batch, unknown)``.
        """
        for each, own in zip(self.errors, self._split(unknowns), strict=True):
            exact = each.apply(exact, states, own)
        return exact

    def columns(self, exact: Tensor, states: Tensor, unknowns: Tensor) -> Tensor:
        """Return the derivative of the readings of one run by the unknowns of the errors.

        The result is ``(time, sensor, unknown)``.

        Args:
            exact: the readings without errors, ``(time, sensor)``.
            states: ``(time, episode, field, *grid)``.
            unknowns: unknowns of the errors, ``(unknown,)``.
        """
        blocks = [
            each.columns(exact, states, own)
            for each, own in zip(self.errors, self._split(unknowns), strict=True)
        ]
        return torch.cat([exact.new_zeros((*exact.shape, 0)), *blocks], dim=-1)

    def _split(self, unknowns: Tensor) -> tuple[Tensor, ...]:
        return unknowns.split([len(each.scales) for each in self.errors], dim=-1)


def _by_episode(operator: ObservationOperator, states: Tensor) -> Tensor:
    """Return ``H u``, ``(…, time, episode, sensor)``, for ``(…, time, episode, field, *grid)``.

    Time and episode are merged into one axis: many small matrix products would be slower.
    """
    episode = states.dim() - 2 - operator.rank
    found = operator(states.flatten(episode - 1, episode))
    return found.unflatten(episode - 1, states.shape[episode - 1 : episode + 1])
