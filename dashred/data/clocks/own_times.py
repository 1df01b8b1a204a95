"""Recordings whose samples are not on a uniform clock."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dashred.data.clocks.resampling import CLOCK_TOLERANCE, MIN_FILLED, native_step
from dashred.data.episodes import Episodes


def has_uneven_times(episodes: Episodes) -> bool:
    """Return whether the samples of an episode are not on a uniform clock, apart from gaps."""
    return any(is_uneven(part.recording.times) for part in episodes.episodes)


def describe_times(episodes: Episodes) -> str:
    """Return a sentence on the times of an uneven recording: their number and their steps."""
    clocks = [part.recording.times for part in episodes.episodes]
    steps = np.concatenate([np.diff(times) for times in clocks])
    several = f" in {len(clocks)} episodes" if len(clocks) > 1 else ""
    apart = f"{steps.min():.3g} to {steps.max():.3g} apart"
    return f"kept the times of {sum(map(len, clocks))} samples{several}, {apart}."


def is_uneven(times: NDArray[np.float64]) -> bool:
    """Return whether times, increasing, are not on a uniform clock, apart from gaps."""
    step = native_step(times)
    places = (times - times[0]) / step
    counts = np.round(places)
    # A small error of the step adds up over a long record, so each step is compared.
    off = np.abs(np.diff(places) - np.diff(counts))
    is_off = bool((off > CLOCK_TOLERANCE * np.maximum(np.diff(counts), 1)).any())
    # Bursts: most samples of such a clock would be empty.
    return is_off or bool(counts[-1] > len(times) / MIN_FILLED)
