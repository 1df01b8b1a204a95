"""Episodes: several recordings of one system by the same sensors.

Each episode has its own initial state and its own clock.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.data.checks import MAX_ABS_VALUE, MIN_EPISODE_SAMPLES
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor


@dataclass(frozen=True)
class Episode:
    """One episode of a recording.

    Attributes:
        name: label in the file; empty if the file has one unnamed episode.
        recording: samples of the episode, on its own clock.
    """

    name: str
    recording: Recording


@dataclass(frozen=True)
class Episodes:
    """All episodes of a file, in file order: at least one, all with the same sensors.

    Attributes:
        episodes: in the order of the file.
        left_out: columns of the file that are neither sensors nor inputs, and are not read.
        is_rounded: whether the file rounds the times so much that the samples got an even clock.
    """

    episodes: tuple[Episode, ...]
    left_out: tuple[str, ...] = ()
    is_rounded: bool = False

    def __post_init__(self) -> None:
        """Check that names are unique and that all episodes have the same sensors."""
        if len({episode.name for episode in self.episodes}) != len(self.episodes):
            raise ValueError("episode names must be unique")
        if any(episode.recording.sensors != self.sensors for episode in self.episodes):
            raise ValueError("all episodes must have the same sensors")

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """The sensors, in the order of the columns."""
        return self.episodes[0].recording.sensors

    def sha256(self) -> str:
        """Hash of the contents; a single episode has the hash of its recording."""
        hashes = [episode.recording.sha256() for episode in self.episodes]
        if len(hashes) == 1:
            return hashes[0]
        names = [episode.name for episode in self.episodes]
        return hashlib.sha256(repr([*zip(names, hashes, strict=True)]).encode()).hexdigest()

    def single(self, path: str) -> Recording:
        """Return the recording of the only episode.

        Raises:
            InputError: there are several episodes.
        """
        if len(self.episodes) > 1:
            problem = f"found {len(self.episodes)} episodes, but one is expected"
            raise InputError(problem, where=path, hint="put each episode in a separate file")
        return self.episodes[0].recording


def with_sensors(episodes: Episodes, sensors: tuple[Sensor, ...]) -> Episodes:
    """Return a recording with other descriptions of its sensors."""
    parts = [
        Episode(part.name, replace(part.recording, sensors=sensors)) for part in episodes.episodes
    ]
    return replace(episodes, episodes=tuple(parts))


def fitted_parts(episodes: Episodes, fitted: int, held_out: float) -> list[Recording]:
    """Return the part of every fitted episode without its held-out end.

    Args:
        episodes: the recording.
        fitted: number of episodes, from the first, that are not held out as a whole.
        held_out: share of each episode, at its end, that is held out.
    """
    found = []
    for part in episodes.episodes[:fitted]:
        times = part.recording.times
        end = float(times[0] + (1 - held_out) * (times[-1] - times[0]))
        found.append(part.recording.between(float(times[0]), end))
    return found


@contextmanager
def name_episode_in_errors(name: str) -> Iterator[None]:
    """Prefix the message of any InputError with the name of the episode, if it has one."""
    try:
        yield
    except InputError as error:
        if not name:
            raise
        what = f"episode {name!r}: {error.what}"
        raise InputError(what, where=error.where, hint=error.hint) from None


@dataclass(frozen=True)
class EpisodeRows:
    """The rows of a file that belong to one episode.

    Attributes:
        name: of the episode.
        rows: slice of the file's rows.
    """

    name: str
    rows: slice

    @property
    def count(self) -> int:
        """Number of rows."""
        return int(self.rows.stop - self.rows.start)

    def location(self, path: str) -> str:
        """Return the location for error messages: the file, and the episode if it has a name."""
        return f"{path}, episode {self.name!r}" if self.name else path


def split_into_episodes(labels: Sequence[str], where: Callable[[int], str]) -> list[EpisodeRows]:
    """Split the rows of a file into episodes.

    Args:
        labels: episode name of every row.
        where: returns the location of a row for error messages.

    Raises:
        InputError: a row has no label, or the rows of an episode are not consecutive.
    """
    begins = [row for row in range(len(labels)) if row == 0 or labels[row] != labels[row - 1]]
    found: list[EpisodeRows] = []
    for begin, end in pairwise([*begins, len(labels)]):
        name = labels[begin]
        if not name:
            hint = "name the episode of every sample, or remove the column"
            raise InputError("the episode name is missing here", where=where(begin), hint=hint)
        if any(name == before.name for before in found):
            problem = f"episode {name!r} continues here after another episode has started"
            hint = "keep the samples of an episode together, or give this part a different name"
            raise InputError(problem, where=where(begin), hint=hint)
        found.append(EpisodeRows(name, slice(begin, end)))
    return found


def runs_of_clock(times: NDArray[np.float64]) -> list[EpisodeRows]:
    """Return the runs of a clock that starts again at its first time; none if it does not.

    A time that goes back to another one, or after a few samples, is rather an error.

    Args:
        times: of all rows, ``(row,)``.
    """
    if not (np.abs(times) <= MAX_ABS_VALUE).all():
        return []
    steps = np.diff(times)
    back = np.flatnonzero(steps < 0) + 1
    edges = [0, *back.tolist(), len(times)]
    if not len(back) or not (steps > 0).any() or np.diff(edges).min() < MIN_EPISODE_SAMPLES:
        return []
    if (times[back] > times[0] + np.median(steps[steps > 0])).any():
        return []
    return [EpisodeRows(str(k), slice(*pair)) for k, pair in enumerate(pairwise(edges), 1)]
