"""Resampling of recordings to the uniform clock of the analysis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.data.checks import MIN_SAMPLES, fewest_samples
from dashred.data.episodes import Episode, Episodes, name_episode_in_errors
from dashred.data.recording import Recording

# A sample is on the clock if its time differs from a clock time by less than this share of a step.
CLOCK_TOLERANCE = 0.01
# An interval without samples longer than this many steps is a gap, which is not interpolated.
MAX_GAP = 2.0
# Largest factor by which cubic interpolation may amplify the noise variance.
MAX_NOISE_GAIN = 3.0
# A clock is mostly empty if less than this share of its samples has any value.
MIN_FILLED = 0.25
# A sensor is sampled off the clock if it has values at fewer clock samples than this share of the
# number that interpolation would give.
MIN_ON_CLOCK = 0.25
# A distance between samples that differs by more than this from every multiple of the step, in
# steps, is random.
RANDOM_OFFSET = 0.1
# A clock with fewer samples than this is not made coarser.
CLOCK_SAMPLES = 20
# More samples than this indicate an error in the times.
MAX_SAMPLES = 10_000_000


def resample(
    recording: Recording, every: float | None, fewest: int = MIN_SAMPLES
) -> tuple[Recording, str]:
    """Return the recording on the clock t₀, t₀ + every, …, and a sentence describing the method.

    Samples on the clock are kept unchanged (decimation). Otherwise each sensor is interpolated
    between neighbouring values: by a cubic through four samples where their spacing allows it,
    else linearly. Gaps longer than 2 steps (of the clock or the recording, whichever is longer)
    stay NaN. A sensor that is read at a constant delay to the others is interpolated, too. A value
    between two gaps moves to the nearest time of the clock.

    Args:
        recording: the samples.
        every: step of the clock, in the unit of time; None keeps the recording's own step, or a
            longer one where most samples of a clock at the own step would be empty: at random
            times, in bursts, or if the own step is the offset between two clocks.
        fewest: smallest number of samples that must be left.

    Raises:
        InputError: ``every`` is shorter than the recording's own step, leaves too few samples, or
            gives too many samples.
    """
    own = native_step(recording.times)
    step = _usable_step(recording) if every is None else every
    clock = _clock(recording.times, own, step, fewest)
    nearest = _nearest(recording.times, clock)
    distance = np.abs(recording.times[nearest] - clock)
    found = distance <= own / 2
    if np.all(distance[found] <= CLOCK_TOLERANCE * own):
        values = np.where(found[:, None], recording.values[nearest], np.nan)
        nth = round(step / own)
        how = f"took one sample of every {nth}" if nth > 1 else "kept samples"
        gap = MAX_GAP * max(own, step)
        if off_clock := _interpolate_off_clock_sensors(values, recording, clock, gap):
            how += f", interpolated {', '.join(off_clock)}"
    else:
        values = _interpolated(recording, clock, MAX_GAP * max(own, step))
        how = "interpolated"
    note = f"{how}: {len(clock)} at a step of {step:.6g}, from {len(recording.times)} at {own:.6g}"
    missing = np.isnan(values).mean()
    sampled = replace(recording, times=clock, values=values)
    return sampled, f"{note}{_missing_share(missing)}."


def resample_all(episodes: Episodes, every: float | None) -> tuple[Episodes, str]:
    """Return every episode on a uniform clock with a common step, and a note on the method.

    Args:
        episodes: the samples.
        every: as in :func:`resample`; None takes the longest of the episodes' own steps.

    Raises:
        InputError: as in :func:`resample`, for the first episode that cannot have the step.
    """
    parts = episodes.episodes
    if len(parts) > 1 and every is None:
        every = max(_usable_step(part.recording) for part in parts)
    sampled, notes = [], []
    spans = [float(part.recording.times[-1] - part.recording.times[0]) for part in parts]
    fewest = MIN_SAMPLES
    if every is not None:
        # The limit keeps the number finite where the step is far too short.
        fewest = fewest_samples([1 + round(min(s / every, MIN_SAMPLES)) for s in spans])
    for part in parts:
        with name_episode_in_errors(part.name):
            recording, note = resample(part.recording, every, fewest)
        sampled.append(Episode(part.name, recording))
        notes.append(note)
    if len(set(notes)) == 1:
        # Of several episodes that are alike, one is described.
        notes = [f"each episode: {notes[0]}" if len(parts) > 1 else notes[0]]
    else:
        notes = [f"{part.name}: {note}" for part, note in zip(parts, notes, strict=True)]
    return Episodes(tuple(sampled)), " ".join(notes)


def native_step(times: NDArray[np.float64]) -> float:
    """Return the mean step between samples, excluding gaps."""
    steps = np.diff(times)
    return float(steps[steps < 1.5 * np.median(steps)].mean())


def coarser_step(recording: Recording) -> float | None:
    """Return a longer step if a clock at the native step would be unsuited, else None.

    It is unsuited if it would be mostly empty, or if the times are random.

    In a table with two clocks, the shortest step is only the offset between the clocks. The
    longest native step of a single sensor is tried first, then the mean step.
    """
    times = recording.times
    own = native_step(times)
    if not (_mostly_empty(recording, own) or _is_random(times, own)):
        return None
    seen = [times[~np.isnan(column)] for column in recording.values.T]
    steps = [native_step(known) for known in seen if len(known) >= CLOCK_SAMPLES]
    for step in (max(steps, default=own), float(np.diff(times).mean())):
        tried = float(f"{step:.6g}")
        if own < tried <= (times[-1] - times[0]) / CLOCK_SAMPLES:
            sampled, _ = resample(recording, tried)
            if np.isnan(sampled.values).mean() < 1 / 2:
                return tried
    return None


def _is_random(times: NDArray[np.float64], step: float) -> bool:
    """Tell whether most of the distances between samples are no multiples of a step."""
    counts = np.diff(times) / step
    off_clock = (np.abs(counts - np.round(counts)) > RANDOM_OFFSET) | (counts < 1 / 2)
    return float(off_clock.mean()) > 1 / 2


def _mostly_empty(recording: Recording, step: float) -> bool:
    count = float(recording.times[-1] - recording.times[0]) / step
    # The number of samples alone can show that the clock is mostly empty.
    if count > len(recording.times) / MIN_FILLED or not CLOCK_SAMPLES < count < MAX_SAMPLES - 1:
        return count > len(recording.times) / MIN_FILLED
    sampled, _ = resample(recording, step)
    return float((~np.isnan(sampled.values)).any(axis=1).mean()) < MIN_FILLED


def _usable_step(recording: Recording) -> float:
    """Return the recording's own step, or a longer one if that clock would be mostly empty."""
    coarser = coarser_step(recording)
    return native_step(recording.times) if coarser is None else coarser


def _interpolate_off_clock_sensors(
    values: NDArray[np.float64], recording: Recording, clock: NDArray[np.float64], gap: float
) -> list[str]:
    """Interpolate sensors with few samples on the clock, in place; return their names."""
    if not np.isnan(values).any():
        return []
    between = _interpolated(recording, clock, gap)
    known, possible = ((~np.isnan(found)).sum(axis=0) for found in (values, between))
    off_clock = known < MIN_ON_CLOCK * possible
    values[:, off_clock] = between[:, off_clock]
    return [name for name, off in zip(recording.names, off_clock, strict=True) if off]


def _clock(times: NDArray[np.float64], own: float, step: float, fewest: int) -> NDArray[np.float64]:
    if step < own * (1 - CLOCK_TOLERANCE):
        problem = f"a step of {step:g} is shorter than the recording's own step, {own:.6g}"
        hint = f"set recording.every to null or to {own:.6g} or more"
        raise InputError(problem, where="recording.every", hint=hint)
    count = int(np.floor((times[-1] - times[0]) / step + CLOCK_TOLERANCE)) + 1
    if count < fewest:
        problem = f"a step of {step:g} leaves {count} samples: at least {fewest} are needed"
        most = (times[-1] - times[0]) / fewest
        hint = f"set recording.every to {most:.3g} or less"
        if most < own:
            hint = "leave out recording.every"
        raise InputError(problem, where="recording.every", hint=hint)
    if count > MAX_SAMPLES:
        problem = f"a step of {step:.6g} from {times[0]:g} to {times[-1]:g} gives {count} samples"
        hint = f"at most {MAX_SAMPLES}: set recording.every, or correct any outlier in the times"
        raise InputError(problem, where="recording.every", hint=hint)
    clock: NDArray[np.float64] = times[0] + step * np.arange(count)
    return clock


def _nearest(times: NDArray[np.float64], clock: NDArray[np.float64]) -> NDArray[np.intp]:
    right = np.searchsorted(times, clock).clip(1, len(times) - 1)
    left_is_nearer = clock - times[right - 1] <= times[right] - clock
    return np.where(left_is_nearer, right - 1, right)


def _interpolated(
    recording: Recording, clock: NDArray[np.float64], gap: float
) -> NDArray[np.float64]:
    values = np.full((len(clock), len(recording.sensors)), np.nan)
    for column, recorded in enumerate(recording.values.T):
        known = ~np.isnan(recorded)
        times = recording.times[known]
        if len(times) < 2:
            continue
        right = np.searchsorted(times, clock).clip(1, len(times) - 1)
        bridged = times[right] - times[right - 1] <= gap
        exact = np.isclose(np.abs(times[_nearest(times, clock)] - clock), 0, atol=1e-9 * gap)
        inside = (clock >= times[0]) & (clock <= times[-1])
        usable = (bridged & inside) | exact
        values[usable, column] = _between(times, recorded[known], clock[usable], gap)
        _keep_lone(values[:, column], times, recorded[known], clock, gap)
    return values


def _keep_lone(
    values: NDArray[np.float64],
    times: NDArray[np.float64],
    recorded: NDArray[np.float64],
    clock: NDArray[np.float64],
    gap: float,
) -> None:
    """Move each value between two gaps to the nearest time of the clock, in place.

    Args:
        values: of one sensor on the clock, ``(clock,)``.
        times: of its recorded values, ``(time,)``.
        recorded: these values, ``(time,)``.
        clock: ``(clock,)``.
        gap: an interval that is longer is not interpolated.
    """
    is_gap = np.concatenate([[True], np.diff(times) > gap, [True]])
    lone = is_gap[:-1] & is_gap[1:]
    step = clock[1] - clock[0]
    places = np.rint((times[lone] - clock[0]) / step).astype(int).clip(0, len(clock) - 1)
    is_near = np.abs(clock[places] - times[lone]) <= step / 2 * (1 + CLOCK_TOLERANCE)
    places, moved = places[is_near], recorded[lone][is_near]
    is_free = np.isnan(values[places])
    values[places[is_free]] = moved[is_free]


def _between(
    times: NDArray[np.float64], values: NDArray[np.float64], at: NDArray[np.float64], gap: float
) -> NDArray[np.float64]:
    """Return values interpolated at times between samples, ``(at,)``.

    Lagrange's cubic through the nearest four samples has an error of O(Δt⁴). Linear
    interpolation, O(Δt²), errs by a percent at 16 samples per period, which a fit would mistake
    for physics; it is used only where the four samples span a gap or are so uneven that the
    cubic would amplify their noise.
    """
    found: NDArray[np.float64] = np.interp(at, times, values)
    if len(times) < 4:
        return found
    first = (np.searchsorted(times, at) - 2).clip(0, len(times) - 4)
    nearest = first[:, None] + np.arange(4)
    t = times[nearest]
    weights = np.ones_like(t)
    for j in range(4):
        for k in range(4):
            if k != j:
                weights[:, j] *= (at - t[:, k]) / (t[:, j] - t[:, k])
    well = (np.diff(t, axis=1).max(axis=1) <= gap) & ((weights**2).sum(axis=1) <= MAX_NOISE_GAIN)
    found[well] = (weights[well] * values[nearest[well]]).sum(axis=1)
    return found


def _missing_share(share: float) -> str:
    return f", {share:.1%} of the values missing" if share else ""
