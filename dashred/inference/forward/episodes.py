"""Several episodes in one array: their times, readings and starts.

Sample k of an episode has the same index as sample k of the others, so that a horizon grows in all
episodes at once. A single recording is one episode::

    times     (time, episode)
    states    (batch, time, episode, field, *grid)
    readings  (batch, time, episode·sensor)

Shorter episodes are padded to the length of the longest: their last time is repeated, and the
readings are NaN.
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
    """Return times ``(time,)`` of episodes as ``(time, episode)``; padding repeats the last."""
    longest = max(map(len, times))
    padded_times = [torch.cat([t, t[-1:].expand(longest - len(t))]) for t in times]
    return torch.stack(padded_times, dim=1)


def stack_readings(values: Sequence[Tensor]) -> Tensor:
    """Return readings ``(time, sensor)`` as ``(time, episode·sensor)``; padding is NaN."""
    longest = max(map(len, values))
    padded = [pad(v, (0, 0, 0, longest - len(v)), value=torch.nan) for v in values]
    # Pairwise, so that the readings of a single recording keep their memory layout.
    return reduce(lambda before, after: torch.hstack((before, after)), padded)


def without_padding(clock: Tensor) -> Tensor:
    """Return the times of an episode without padding."""
    return clock[: 1 + int((clock[1:] > clock[:-1]).sum())]


def concatenate_episodes(values: Tensor, times: Tensor) -> Tensor:
    """Return samples ``(time, episode, …)`` as ``(sample, …)``, without padding.

    Args:
        values: values of every sample.
        times: ``(time, episode)``.
    """
    ends = [len(without_padding(clock)) for clock in times.T]
    return torch.cat([values[:end, e] for e, end in enumerate(ends)])


@dataclass(frozen=True)
class EpisodeStarts:
    """The starts of all episodes: ``u₀ = (start_1(z_1), …, start_E(z_E))``."""

    models: tuple[StartModel, ...]

    @property
    def size(self) -> int:
        """Number of independent standard normals z."""
        return sum(model.size for model in self.models)

    def start(self, z: Tensor) -> Tensor:
        """Return the starts ``(batch, episode, field, *grid)`` for ``z``, ``(batch, size)``."""
        blocks = z.split([model.size for model in self.models], dim=1)
        starts = [m.start(block) for m, block in zip(self.models, blocks, strict=True)]
        return torch.stack(starts, dim=1)
