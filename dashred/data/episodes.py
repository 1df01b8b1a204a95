"""Episodes: recordings of one system by the same sensors, each with its own start and clock."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise

from dashred.core.errors import InputError
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor


@dataclass(frozen=True)
class Episode:
    """One stretch of a recording that begins anew.

    Attributes:
        name: what the file calls it; empty where it has one episode without a name.
        recording: its samples, on its own clock.
    """

    name: str
    recording: Recording


@dataclass(frozen=True)
class Episodes:
    """All episodes of a file, in its order: one at least, with the same sensors."""

    episodes: tuple[Episode, ...]

    def __post_init__(self) -> None:
        """Hold the sensors and the names to what readers promise."""
        if len({episode.name for episode in self.episodes}) != len(self.episodes):
            raise ValueError("episodes need names of their own")
        if any(episode.recording.sensors != self.sensors for episode in self.episodes):
            raise ValueError("episodes have the same sensors")

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """The sensors, in the order of the columns."""
        return self.episodes[0].recording.sensors

    def sha256(self) -> str:
        """Hash of the contents; of one episode alone that of its recording, whatever its name."""
        hashes = [episode.recording.sha256() for episode in self.episodes]
        if len(hashes) == 1:
            return hashes[0]
        names = [episode.name for episode in self.episodes]
        return hashlib.sha256(repr([*zip(names, hashes, strict=True)]).encode()).hexdigest()

    def alone(self, path: str) -> Recording:
        """Return the recording of one episode.

        Raises:
            InputError: there are several.
        """
        if len(self.episodes) > 1:
            problem = f"{len(self.episodes)} episodes, where one is expected"
            raise InputError(problem, where=path, hint="give each episode a file of its own")
        return self.episodes[0].recording


@contextmanager
def said_of(name: str) -> Iterator[None]:
    """Let errors name the episode that they are about, if it has a name."""
    try:
        yield
    except InputError as error:
        if not name:
            raise
        what = f"episode {name!r}: {error.what}"
        raise InputError(what, where=error.where, hint=error.hint) from None


@dataclass(frozen=True)
class Stretch:
    """The rows of a file that are one episode.

    Attributes:
        name: of the episode.
        rows: these.
    """

    name: str
    rows: slice

    def within(self, path: str) -> str:
        """Where it stands: the file, and the episode if it has a name."""
        return f"{path}, episode {self.name!r}" if self.name else path


def stretches(labels: Sequence[str], where: Callable[[int], str]) -> list[Stretch]:
    """Return the episodes of a file, by the label of each row.

    Args:
        labels: of every row.
        where: tells where a row stands.

    Raises:
        InputError: a row has no label, or an episode goes on after another has begun.
    """
    begins = [row for row in range(len(labels)) if row == 0 or labels[row] != labels[row - 1]]
    found: list[Stretch] = []
    for begin, end in pairwise([*begins, len(labels)]):
        name = labels[begin]
        if not name:
            hint = "name the episode of every sample, or leave the column out"
            raise InputError("the episode is missing here", where=where(begin), hint=hint)
        if any(name == before.name for before in found):
            problem = f"episode {name!r} goes on here, after another has begun"
            hint = "keep the samples of an episode together, or give this part a name of its own"
            raise InputError(problem, where=where(begin), hint=hint)
        found.append(Stretch(name, slice(begin, end)))
    return found
