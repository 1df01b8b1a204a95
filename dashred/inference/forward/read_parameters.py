"""Parameters that sensors depend on: the derivative of the readings with respect to them.

With changes c of these parameters the sensors read ``H(u) + Σ_p c_p ∂H/∂p(u, t)``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor
from dashred.inference.forward.candidates import Candidate
from dashred.physics.expressions.algebra import to_text
from dashred.physics.parameter_sensitivity import reading_slopes
from dashred.physics.system import System


class _Slopes(NamedTuple):
    """``∂H/∂p`` in one episode.

    Attributes:
        columns: of the sensors that depend on p.
        operator: reads their derivatives.
    """

    columns: list[int]
    operator: ObservationOperator


@dataclass(frozen=True)
class ReadParameters:
    """The parameters that sensors depend on.

    Attributes:
        sensors: number of sensors of an episode.
        slopes: of each parameter, for every episode.
    """

    sensors: int
    slopes: dict[str, list[_Slopes]]

    def index(self, candidates: Sequence[Candidate]) -> list[int]:
        """Return which candidates are changes of a parameter that a sensor depends on."""
        return [j for j, c in enumerate(candidates) if c.equation is None and c.name in self.slopes]

    def columns(self, names: Sequence[str], states: Tensor, times: Tensor) -> Tensor:
        """Return ``∂H/∂p``, ``(…, time, episode·sensor, parameter)``.

        Args:
            names: of the parameters.
            states: ``(…, time, episode, field, *grid)``.
            times: ``(time, episode)``.
        """
        whole = []
        for name in names:
            episodes = []
            for episode, (columns, operator) in enumerate(self.slopes[name]):
                axis = states.dim() - operator.rank - 2
                own = states.select(axis, episode)
                found = own.new_zeros((*own.shape[:axis], self.sensors))
                found[..., columns] = operator(own, times[:, episode].numpy())
                episodes.append(found)
            whole.append(torch.stack(episodes, dim=-2).flatten(-2))
        return torch.stack(whole, dim=-1)

    def effect(
        self, candidates: Sequence[Candidate], changes: Tensor, states: Tensor, times: Tensor
    ) -> Tensor:
        """Return what changes of parameters add to readings, ``(batch, time, episode·sensor)``.

        Args:
            candidates: some of those of :meth:`index`.
            changes: their values, ``(batch, candidate)``.
            states: ``(batch, time, episode, field, *grid)``.
            times: ``(time, episode)``.
        """
        slopes = self.columns([candidate.name for candidate in candidates], states, times)
        return (slopes @ changes[:, None, :, None].to(slopes))[..., 0]


def read_parameters(sensors: Sequence[Sensor], systems: Sequence[System]) -> ReadParameters | None:
    """Return the parameters that sensors depend on; None if there are none.

    Args:
        sensors: of one episode.
        systems: of every episode, driven by its inputs.
    """
    first = systems[0]
    slopes = [reading_slopes(first, sensor.quantities) for sensor in sensors]
    names = sorted(set().union(*slopes))
    if not names:
        return None
    let = dict(first.config.let)
    found: dict[str, list[_Slopes]] = {}
    for name in names:
        columns = [column for column, own in enumerate(slopes) if name in own]
        own_sensors = []
        for column in columns:
            label = f"slope_{len(let)}"
            while label in first.names:
                label += "_"
            let[label] = to_text(slopes[column][name])
            own_sensors.append(replace(sensors[column], reads=label))
        found[name] = []
        for system in systems:
            sloped = system.with_config(replace(system.config, let=dict(let)))
            found[name].append(_Slopes(columns, ObservationOperator(own_sensors, sloped)))
    return ReadParameters(len(sensors), found)
