"""Guess the values of a first configuration from the recording: start, spread and clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.data.clocks.own_times import is_uneven
from dashred.data.clocks.resampling import coarser_step
from dashred.data.clocks.time_scale import lost_change, samples_per_change, suggested_step
from dashred.data.io.missing_sentinels import mask_sentinels
from dashred.data.noise_level import noise_std
from dashred.data.recording import Recording
from dashred.pipeline.init.guessed_system import GuessedSystem
from dashred.pipeline.init.relations import Rate, find_rates
from dashred.pipeline.init.start import start_expression

# Spread of the start: at least this many σ of the noise, and for an ODE this share of the std, or
# the change in the first tenth of the record, if that is smaller: growth from nothing.
NOISE_FACTOR, STD_SHARE = 3.0, 0.1

# A recording of an ODE system with uneven times and more samples than this is moved to a clock.
MANY_SAMPLES = 3000


@dataclass(frozen=True)
class GuessedValues:
    """Values of a first configuration.

    Attributes:
        every: time step of the analysis; None keeps the step of the recording.
        start, spread: initial state and its std by field, in the unit of the field.
        rates: columns that are the rate of change of a field, by field; empty in space.
        episodes: number of episodes of the recording.
    """

    every: float | None
    start: dict[str, str]
    spread: dict[str, float]
    rates: dict[str, Rate]
    episodes: int


def guess_values(guessed: GuessedSystem, episodes: Sequence[Recording]) -> GuessedValues:
    """Guess the values of a configuration; the time steps come from the longest episode.

    All episodes share one prior of the start. Its mean is the mean of their first values, and its
    spread covers the differences between them.
    """
    episodes = [replace(episode, values=mask_sentinels(episode.values)) for episode in episodes]
    recording = longest_episode(episodes)
    noise = _noise(recording, [each for each in episodes if each is not recording])
    every = _step(guessed, recording, noise)
    start, spread = {}, {}
    for field in guessed.fields:
        selected = [sensor.reads == field for sensor in recording.sensors]
        known = [~np.isnan(episode.values[:, selected]) for episode in episodes]
        most = max(range(len(episodes)), key=lambda i: (known[i].any(axis=0).sum(), known[i].sum()))
        values = episodes[most].values[:, selected]
        values = values[:, known[most].any(axis=0)]
        places = np.array([s.position for s in recording.sensors if s.reads == field])
        firsts = np.stack([_first_values(episode.values[:, selected]) for episode in episodes])
        start[field] = start_expression(guessed.axes, places, np.nanmean(firsts, axis=0))
        std = float(np.nanstd(values))
        early = max(map(_early_change, values.T))
        between_episodes = float(np.nanmax(np.nanstd(firsts, axis=0)))
        spread[field] = (
            _rounded(
                max(
                    NOISE_FACTOR * float(noise[selected].max()),
                    std if guessed.axes else min(STD_SHARE * std, early),
                    between_episodes,
                )
            )
            or STD_SHARE * std
            or 1.0
        )
    return GuessedValues(
        every,
        start,
        spread,
        {} if guessed.axes else find_rates(recording),
        len(episodes),
    )


def _step(guessed: GuessedSystem, recording: Recording, noise: NDArray[np.float64]) -> float | None:
    """Return the time step of the analysis; None keeps the times of the recording."""
    if not guessed.axes and is_uneven(recording.times) and len(recording.times) < MANY_SAMPLES:
        return None
    every = coarser_step(recording)
    if every is not None and not guessed.axes and lost_change(recording, noise, every) is not None:
        return None
    return every or suggested_step(recording, samples_per_change(recording, noise), noise)


def longest_episode(episodes: Sequence[Recording]) -> Recording:
    """Return the episode with the most samples."""
    return max(episodes, key=lambda episode: len(episode.times))


def _noise(recording: Recording, others: Sequence[Recording]) -> NDArray[np.float64]:
    try:
        return noise_std(recording, *others)
    except InputError:
        # A sensor never changes. The check reports this.
        return np.zeros(len(recording.sensors))


def _early_change(values: NDArray[np.float64]) -> float:
    """Return the range of the first tenth of the known values."""
    known = values[~np.isnan(values)]
    return float(np.ptp(known[: max(2, len(known) // 10)]))


def _first_values(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the first value of each sensor, ``(sensor,)``."""
    known = ~np.isnan(values)
    firsts: NDArray[np.float64] = values[known.argmax(axis=0), np.arange(values.shape[1])]
    return firsts


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")
