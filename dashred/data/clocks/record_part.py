"""The part of a recording that is used: without a start-up, or a tail."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NoReturn

import numpy as np

from dashred.core.errors import InputError
from dashred.core.stated.record_part import BEGIN, END, RecordPart
from dashred.data.checks import fewest_samples
from dashred.data.episodes import Episode, Episodes

ROUNDING = 1e-12


class EmptySensorsError(InputError):
    """Sensors have no values in the part of the recording that is used.

    Attributes:
        names: of the sensors.
    """

    def __init__(self, names: Sequence[str], what: str, *, where: str, hint: str) -> None:
        """Store the names beside the parts of the message."""
        super().__init__(what, where=where, hint=hint)
        self.names = tuple(names)


def part_of(
    episodes: Episodes, part: RecordPart, path: str, of_date: Callable[[str], float] | None = None
) -> Episodes:
    """Return a part of every episode; an episode without readings in it is left out.

    Inputs remain whole: the value before the first sample may hold until then.

    Args:
        episodes: the whole recording.
        part: begin and end, on the clock of each episode.
        path: of the recording, for error messages.
        of_date: returns the time of a date, NaN if it is none; None if the times are numbers.

    Raises:
        InputError: a bound is a date that cannot be used, or too few samples are left.
        EmptySensorsError: no values of a sensor are left in any episode.
    """
    left = episodes if part.is_whole else _cut(episodes, part, of_date)
    _check_read(left, part, path)
    return left


def _cut(episodes: Episodes, part: RecordPart, of_date: Callable[[str], float] | None) -> Episodes:
    """Return a part of every episode that has readings in it.

    Raises:
        InputError: a bound is a date that cannot be used, or too few samples are left.
    """
    largest = max(float(np.abs(e.recording.times).max()) for e in episodes.episodes)
    # A time such as 0.3 may be 0.1 + 0.2 in the recording.
    first = _time(part.begin, BEGIN, of_date, -math.inf) - ROUNDING * largest
    last = _time(part.end, END, of_date, math.inf) + ROUNDING * largest
    cut = [Episode(e.name, e.recording.between(first, last)) for e in episodes.episodes]
    left = [episode for episode in cut if not np.isnan(episode.recording.values).all()]
    counts = [len(episode.recording.times) for episode in left]
    fewest = fewest_samples(counts)
    few = min(left, key=lambda episode: len(episode.recording.times), default=None)
    if few is None or len(few.recording.times) < fewest:
        _raise_too_few(episodes, part, few, fewest)
    return replace(episodes, episodes=tuple(left))


def _check_read(episodes: Episodes, part: RecordPart, path: str) -> None:
    """Check that every sensor has values in one episode at least.

    Raises:
        EmptySensorsError: one has none.
    """
    known = [episode.recording.is_read() for episode in episodes.episodes]
    names = [
        sensor.name
        for sensor, is_read in zip(episodes.sensors, np.any(known, axis=0), strict=True)
        if not is_read
    ]
    if not names:
        return
    listed, few = ", ".join(map(repr, names)), len(names) == 1
    problem = f"sensor {listed} has no values" if few else f"sensors {listed} have no values"
    hint = f"leave {'it' if few else 'them'} out: recording.ignore=[NAME]"
    if not part.is_whole:
        problem += f" in the part {part}"
        hint = f"change {BEGIN} or {END}, or {hint}"
    raise EmptySensorsError(names, problem, where=path, hint=hint)


def _raise_too_few(
    episodes: Episodes, part: RecordPart, few: Episode | None, fewest: int
) -> NoReturn:
    count = 0 if few is None else len(few.recording.times)
    of = f" of episode {few.name!r}" if few is not None and few.name else ""
    clocks = [episode.recording.times for episode in episodes.episodes]
    begin, end = min(clock[0] for clock in clocks), max(clock[-1] for clock in clocks)
    problem = f"the part {part} contains {count} samples{of}: at least {fewest} are needed"
    hint = f"the recording runs from t = {begin:.10g} to {end:.10g}, in the system's unit of time"
    raise InputError(problem, where=f"{BEGIN}, {END}", hint=hint)


def _time(
    bound: float | str | None, key: str, of_date: Callable[[str], float] | None, unbounded: float
) -> float:
    """Return a bound as a time.

    Raises:
        InputError: it is a text, and not a date of the recording's kind.
    """
    if bound is None:
        return unbounded
    if not isinstance(bound, str):
        return float(bound)
    if of_date is None:
        problem = f"{bound!r} is not a number, but the times of the recording are numbers"
        raise InputError(problem, where=key, hint="give the time in the unit of time of the system")
    found = of_date(bound.strip())
    if math.isnan(found):
        problem = f"{bound!r} is not a date"
        hint = "write it as in the recording, or as 2024-05-17 12:30:00"
        raise InputError(problem, where=key, hint=hint)
    return found
