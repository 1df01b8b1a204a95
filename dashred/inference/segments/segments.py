"""Cut the episodes of a recording into short segments, each with a state of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Samples from one node to the next: few enough for a chaotic trajectory to be followed.
SAMPLES = 4
# With more segments than this, each segment gets longer.
LARGEST_COUNT = 400


@dataclass(frozen=True)
class Segments:
    """The record as consecutive segments; the last sample of one is the first of the next.

    An episode's last segment may be shorter: its clock then stands still.

    Attributes:
        times: of the samples, ``(segment, 1 + interval)``.
        readings: ``(segment, 1 + interval, sensor)``; NaN where missing, and at the last sample,
            which the next segment has, except in the last segment of an episode.
        episode: of each segment, ``(segment,)``.
        relative: σ of every reading as a factor of its sensor's σ, like the readings; or 1.
        at_stop: which readings are at the stop of a sensor, like the readings; None without any.
    """

    times: Array
    readings: Array
    episode: NDArray[np.intp]
    relative: Array | float = 1.0
    at_stop: NDArray[np.bool_] | None = None

    @cached_property
    def available(self) -> NDArray[np.bool_]:
        """Which readings there are, ``(segment, 1 + interval, sensor)``."""
        return np.isfinite(self.readings)

    @property
    def count(self) -> int:
        """Number of segments."""
        return len(self.times)

    @cached_property
    def follows(self) -> NDArray[np.bool_]:
        """Whether each segment but the last continues in the next one, ``(segment - 1,)``."""
        found: NDArray[np.bool_] = self.episode[1:] == self.episode[:-1]
        return found

    @cached_property
    def begins(self) -> NDArray[np.intp]:
        """Index of the first segment of every episode, ``(episode,)``."""
        return np.flatnonzero(np.r_[True, ~self.follows])

    def only(self, segment: int) -> Segments:
        """Return one segment alone."""
        chosen = slice(segment, segment + 1)
        at_stop = None if self.at_stop is None else self.at_stop[chosen]
        relative = self.relative if isinstance(self.relative, float) else self.relative[chosen]
        return Segments(
            self.times[chosen], self.readings[chosen], self.episode[chosen], relative, at_stop
        )

    def join(self, values: Array, episode: int) -> Array:
        """Return values of one episode's segments one after the other, ``(time, …)``.

        Args:
            values: ``(segment, 1 + interval, …)``.
            episode: index of the episode.
        """
        mine = np.flatnonzero(self.episode == episode)
        inner, last = values[mine[:-1], :-1], mine[-1]
        # The last segment ends where its clock begins to stand still.
        length = 1 + int((np.diff(self.times[last]) > 0).sum())
        joined: Array = np.concatenate(
            [inner.reshape(-1, *values.shape[2:]), values[last, :length]]
        )
        return joined

    @cached_property
    def noisy(self) -> NDArray[np.bool_]:
        """Which readings are not at a stop, ``(segment, 1 + interval, sensor)``."""
        return self.available if self.at_stop is None else self.available & ~self.at_stop

    @cached_property
    def seen(self) -> int:
        """Number of readings that are not at a stop."""
        return int(self.noisy.sum())

    @property
    def span(self) -> float:
        """Median duration of a segment."""
        return float(np.median(self.times[:, -1] - self.times[:, 0]))


def cut(
    times: Sequence[Array],
    readings: Sequence[Array],
    samples: int = SAMPLES,
    relative: Sequence[Array | None] = (),
    at_stop: Sequence[Array | None] = (),
) -> Segments:
    """Return the segments of some episodes.

    Args:
        times: clock of each episode, ``(time,)``.
        readings: of each, ``(time, sensor)``; NaN where missing.
        samples: from one node to the next; more if there would be too many segments.
        relative: σ of every reading as a factor of its sensor's σ, ``(time, sensor)`` by episode;
            None for 1.
        at_stop: 1 for readings at the stop of a sensor, else 0, ``(time, sensor)`` by episode; None
            without any.
    """
    total = sum(map(len, times))
    intervals = max(samples, -(-total // LARGEST_COUNT))
    parts = [
        _cut_episode(clock, values, intervals, episode)
        for episode, (clock, values) in enumerate(zip(times, readings, strict=True))
    ]
    clocks, found, owners = zip(*parts, strict=True)
    sizes, stops = (_cut_beside(times, readings, each, intervals) for each in (relative, at_stop))
    return Segments(
        np.concatenate(clocks),
        np.concatenate(found),
        np.concatenate(owners),
        1.0 if sizes is None else np.nan_to_num(sizes, nan=1.0),
        None if stops is None else stops == 1,
    )


def _cut_beside(
    times: Sequence[Array],
    readings: Sequence[Array],
    values: Sequence[Array | None],
    intervals: int,
) -> Array | None:
    """Return values that belong to the readings, cut like these; None if there are none."""
    known = [each for each in values if each is not None]
    if not known:
        return None
    rows = [
        _cut_episode(clock, own, intervals, 0)[1] for clock, own in zip(times, known, strict=True)
    ]
    return np.concatenate(rows)


def _cut_episode(
    times: Array, readings: Array, intervals: int, episode: int
) -> tuple[Array, Array, NDArray[np.intp]]:
    count = max(1, -(-(len(times) - 1) // intervals))
    places = np.arange(count)[:, None] * intervals + np.arange(intervals + 1)
    beyond = places >= len(times)
    places = np.minimum(places, len(times) - 1)
    values = readings[places].copy()
    values[beyond] = np.nan
    # The next segment has this sample.
    values[:-1, -1] = np.nan
    return times[places], values, np.full(count, episode, dtype=np.intp)
