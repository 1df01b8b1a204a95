"""Numbers of a first configuration: start, spread, steps, from what the recording shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.data.io.missing_sentinels import mask_sentinels
from dashred.data.noise_level import noise_std
from dashred.data.recording import Recording
from dashred.data.resampling import coarser_step, native_step
from dashred.data.time_scale import samples_per_change, suggested_step
from dashred.pipeline.init.columns import Guessed
from dashred.pipeline.init.relations import Rate, find_rates
from dashred.pipeline.init.start import start_expression

# Steps of the integrator in one of the recording's.
STEPS_A_SAMPLE = 5
# The start is known to so many σ of the noise, and to this share of what is seen to vary.
STARTS, SHARE = 3.0, 0.1


@dataclass(frozen=True)
class Guess:
    """What a first configuration says of a recording.

    Attributes:
        every: step of the analysis; None keeps the recording's own.
        dt: step of the integrator.
        start, spread: of every field, in its own unit.
        rates: columns that are another's rate of change, by field; of an ODE.
        episodes: how many begin the recording anew.
    """

    every: float | None
    dt: float
    start: dict[str, str]
    spread: dict[str, float]
    rates: dict[str, Rate]
    episodes: int


def guess(guessed: Guessed, episodes: Sequence[Recording]) -> Guess:
    """Guess what the recording lets one guess: its steps from the longest episode.

    A law has one prior of the start, whatever the episode: about the mean of what they begin with,
    as wide as that differs.
    """
    episodes = [replace(each, values=mask_sentinels(each.values)) for each in episodes]
    recording = longest(episodes)
    noise = _noise(recording)
    every = coarser_step(recording)
    if every is None:
        every = suggested_step(recording, samples_per_change(recording, noise))
    step = native_step(recording.times) if every is None else every
    start, spread = {}, {}
    for field in guessed.fields:
        mine = [sensor.reads == field for sensor in recording.sensors]
        values = recording.values[:, mine]
        places = np.array([s.position for s in recording.sensors if s.reads == field])
        firsts = np.stack([_firsts(each.values[:, mine]) for each in episodes])
        start[field] = start_expression(guessed.axes, places, np.nanmean(firsts, axis=0))
        varies = float(np.nanstd(values))
        known = SHARE * varies if not guessed.axes else varies
        known = max(known, float(np.nanmax(np.nanstd(firsts, axis=0))))
        spread[field] = _rounded(max(STARTS * float(noise[mine].max()), known)) or 1.0
    return Guess(
        every,
        _rounded(step / STEPS_A_SAMPLE),
        start,
        spread,
        {} if guessed.axes else find_rates(recording),
        len(episodes),
    )


def longest(episodes: Sequence[Recording]) -> Recording:
    """Return the episode of most samples."""
    return max(episodes, key=lambda each: len(each.times))


def _noise(recording: Recording) -> NDArray[np.float64]:
    try:
        return noise_std(recording)
    except InputError:
        # A sensor that never changes: what to do about it is for the check to say.
        return np.zeros(len(recording.sensors))


def _firsts(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the first value that each sensor has."""
    seen = ~np.isnan(values)
    found: NDArray[np.float64] = values[seen.argmax(axis=0), np.arange(values.shape[1])]
    return found


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")
