"""Several episodes at once: starts, clocks and readings side by side, one law for all.

Sample k of every episode stands beside sample k of the others, so a horizon grows in all at once::

    times     (time, episode)
    states    (batch, time, episode, field, *grid)
    readings  (batch, time, episode·sensor)

An episode that has ended stands still, its clock and its state, and nothing is recorded there. Of
one episode alone everything is as it is without this module: it has no such dimension. Their
simulator is in ``episodes_simulator.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.inference.initial_state.start_models import StartModel


def clocks(times: Sequence[Tensor]) -> Tensor:
    """Return the clocks of episodes side by side, ``(time, episode)``; of one, its ``(time,)``."""
    if len(times) == 1:
        return times[0]
    longest = max(map(len, times))
    held = [torch.cat([t, t[-1:].expand(longest - len(t))]) for t in times]
    return torch.stack(held, dim=1)


def running(clock: Tensor) -> Tensor:
    """Return an episode's clock until it stands still."""
    return clock[: 1 + int((clock[1:] > clock[:-1]).sum())]


def side_by_side(values: Sequence[Tensor]) -> Tensor:
    """Return what episodes ``(time, sensor)`` recorded as ``(time, episode·sensor)``, else NaN."""
    if len(values) == 1:
        return values[0]
    longest = max(map(len, values))
    padded = [
        torch.cat([v, v.new_full((longest - len(v), *v.shape[1:]), torch.nan)]) for v in values
    ]
    return torch.cat(padded, dim=1)


@dataclass(frozen=True)
class EpisodeStarts:
    """``u₀ = (start_1(z_1), …, start_E(z_E))``, z in blocks."""

    models: tuple[StartModel, ...]

    @property
    def size(self) -> int:
        """Number of independent standard normals z."""
        return sum(model.size for model in self.models)

    def start(self, z: Tensor) -> Tensor:
        """Return the starts ``(batch, episode, field, *grid)`` of ``z``, ``(batch, size)``."""
        blocks = z.split([model.size for model in self.models], dim=1)
        starts = [m.start(block) for m, block in zip(self.models, blocks, strict=True)]
        return torch.stack(starts, dim=1)


def starts_of(models: Sequence[StartModel]) -> StartModel:
    """Return the start of all episodes; of one, its own."""
    return models[0] if len(models) == 1 else EpisodeStarts(tuple(models))


class EpisodesOperator(ObservationOperator):
    """H of every episode: the same sensors, their columns side by side."""

    def __init__(self, operator: ObservationOperator, episodes: int) -> None:
        torch.nn.Module.__init__(self)
        self.operator = operator
        self.sensors = operator.sensors * episodes

    def forward(self, state: Tensor, t: float = 0.0) -> Tensor:
        """Read states ``(*batch, episode, field, *grid)``: ``(*batch, episode·sensor)``."""
        return self.operator(state, t).flatten(-2)


def operator_of(operator: ObservationOperator, episodes: int) -> ObservationOperator:
    """Return H of so many episodes; of one, its own."""
    return operator if episodes == 1 else EpisodesOperator(operator, episodes)


def one_after_another(values: Tensor, times: Tensor) -> Tensor:
    """Return samples ``(time, episode, …)`` episode by episode, without those after its end.

    Args:
        values: of every sample.
        times: ``(time, episode)``; of one episode ``(time,)``, and then the values are as they are.
    """
    if times.dim() == 1:
        return values
    ends = [len(running(clock)) for clock in times.T]
    return torch.cat([values[:end, e] for e, end in enumerate(ends)])
