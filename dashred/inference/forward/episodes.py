"""Several episodes in one array: their clocks, readings and starts.

Sample k of every episode stands beside sample k of the others, so that a horizon grows in all of
them at once. A single recording is one episode::

    times     (time, episode)
    states    (batch, time, episode, field, *grid)
    readings  (batch, time, episode·sensor)

An episode that is shorter than the longest is padded: its clock stands still and its readings are
missing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import torch
from torch import Tensor
from torch.nn.functional import pad

from dashred.inference.initial_state.start_models import StartModel


def stack_times(times: Sequence[Tensor]) -> Tensor:
    """Return clocks ``(time,)`` as ``(time, episode)``; padding repeats the last time."""
    longest = max(map(len, times))
    held = [torch.cat([t, t[-1:].expand(longest - len(t))]) for t in times]
    return torch.stack(held, dim=1)


def stack_readings(values: Sequence[Tensor]) -> Tensor:
    """Return readings ``(time, sensor)`` as ``(time, episode·sensor)``; padding is NaN."""
    longest = max(map(len, values))
    padded = [pad(v, (0, 0, 0, longest - len(v)), value=torch.nan) for v in values]
    # Pair by pair, so that the readings of a single recording keep their order in memory.
    return reduce(lambda before, after: torch.hstack((before, after)), padded)


def without_padding(clock: Tensor) -> Tensor:
    """Return a padded clock without its padding."""
    return clock[: 1 + int((clock[1:] > clock[:-1]).sum())]


def concatenate_episodes(values: Tensor, times: Tensor) -> Tensor:
    """Return samples ``(time, episode, …)`` as ``(sample, …)``, without padding.

    Args:
        values: of every sample.
        times: ``(time, episode)``.
    """
    ends = [len(without_padding(clock)) for clock in times.T]
    return torch.cat([values[:end, e] for e, end in enumerate(ends)])


@dataclass(frozen=True)
class EpisodeStarts:
    """A start for each episode: ``u₀ = (start_1(z_1), …, start_E(z_E))``, z in blocks."""

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
