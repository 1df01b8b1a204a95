"""The analysis clock: recordings brought to samples at equal steps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.data.checks import FEWEST_SAMPLES
from dashred.data.episodes import Episode, Episodes, said_of
from dashred.data.recording import Recording

# Times count as lying on a clock when they miss it by less than this part of a step.
ON_CLOCK = 0.01
# A stretch without samples that is longer than this many steps is a gap, not to be bridged.
GAP = 2.0
# By how much a cubic through four samples may make the variance of their noise larger.
NOISIER = 3.0
# A clock on which less than this share of the samples has any value is empty for the most part.
EMPTY = 0.25
# A sensor that has values at fewer of the clock's samples than this share of what interpolation
# gives it is sampled beside them.
BESIDE = 0.25
# More than this is a slip in the times rather than a recording.
MOST_SAMPLES = 10_000_000


def resample(recording: Recording, every: float | None) -> tuple[Recording, str]:
    """Return the recording on the clock t₀, t₀ + every, …, and a sentence that says how.

    Samples that lie on the clock are taken as they are (decimation); otherwise each sensor is
    interpolated between its neighbouring values, by a cubic through four where they stand well,
    except across gaps of more than 2 steps (of the clock or the recording, whichever is longer),
    which stay NaN; a sensor that is always read a little later than another is interpolated, too.
    ``every`` is in the unit of time; None keeps the recording's own step.

    Raises:
        InputError: if ``every`` is shorter than the recording's own step, or so long that fewer
            than 20 samples would remain, or the samples would be more than a machine can hold; if
            it is None and the recording's own step is that between one clock and another.
    """
    own = own_step(recording.times)
    step = _usable_step(recording) if every is None else every
    clock = _clock(recording.times, own, step)
    nearest = _nearest(recording.times, clock)
    distance = np.abs(recording.times[nearest] - clock)
    found = distance <= own / 2
    if np.all(distance[found] <= ON_CLOCK * own):
        values = np.where(found[:, None], recording.values[nearest], np.nan)
        nth = round(step / own)
        how = f"took one sample of every {nth}" if nth > 1 else "kept samples"
        if beside := _fill_in_beside(values, recording, clock, GAP * max(own, step)):
            how += f", interpolated {', '.join(beside)}"
    else:
        values = _interpolated(recording, clock, GAP * max(own, step))
        how = "interpolated"
    says = f"{how}: {len(clock)} at a step of {step:.6g}, from {len(recording.times)} at {own:.6g}"
    missing = np.isnan(values).mean()
    sampled = replace(recording, times=clock, values=values)
    return sampled, f"{says}{_missing(missing)}."


def resample_all(episodes: Episodes, every: float | None) -> tuple[Episodes, str]:
    """Return every episode on a clock of its own, all with one step, and how that came about.

    ``every`` as :func:`resample` has it; None takes the longest of the episodes' own steps.

    Raises:
        InputError: as :func:`resample`, of the first episode that cannot have the step.
    """
    parts = episodes.episodes
    if len(parts) > 1 and every is None:
        every = max(_usable_steps(parts))
    sampled, said = [], []
    for part in parts:
        with said_of(part.name):
            recording, says = resample(part.recording, every)
        sampled.append(Episode(part.name, recording))
        said.append(f"{part.name}: {says}" if part.name else says)
    return Episodes(tuple(sampled)), " ".join(said)


def own_step(times: NDArray[np.float64]) -> float:
    """The step of a recording: the mean of its steps, gaps left out."""
    steps = np.diff(times)
    return float(steps[steps < 1.5 * np.median(steps)].mean())


def fuller_step(recording: Recording) -> float | None:
    """Return a longer step, where a clock of the own one would be empty for the most part.

    Two clocks in one table, one a little behind the other, have a shortest step that says nothing
    of either. Tried are the longest step of a sensor that reads at its own times, and the mean one.
    None where the own step is as good as any.
    """
    times = recording.times
    own = own_step(times)
    if not _mostly_empty(recording, own):
        return None
    seen = [times[~np.isnan(column)] for column in recording.values.T]
    steps = [own_step(known) for known in seen if len(known) >= FEWEST_SAMPLES]
    for step in (max(steps, default=own), float(np.diff(times).mean())):
        tried = float(f"{step:.6g}")
        if own < tried <= (times[-1] - times[0]) / FEWEST_SAMPLES:
            sampled, _ = resample(recording, tried)
            if np.isnan(sampled.values).mean() < 1 / 2:
                return tried
    return None


def _mostly_empty(recording: Recording, step: float) -> bool:
    count = float(recording.times[-1] - recording.times[0]) / step
    # So few samples cannot fill so long a clock: that need not be tried.
    if count > len(recording.times) / EMPTY or not FEWEST_SAMPLES < count < MOST_SAMPLES - 1:
        return count > len(recording.times) / EMPTY
    sampled, _ = resample(recording, step)
    return float((~np.isnan(sampled.values)).any(axis=1).mean()) < EMPTY


def _usable_step(recording: Recording) -> float:
    """Return the recording's own step.

    Raises:
        InputError: another one is needed.
    """
    step, fuller = own_step(recording.times), fuller_step(recording)
    if fuller is None:
        return step
    span = float(recording.times[-1] - recording.times[0])
    problem = (
        f"at the recording's own step of {step:.6g} nearly all of {span / step:.0f} samples would "
        f"be empty: there are {len(recording.times)}"
    )
    hint = f"are there two clocks in one table? Set recording.every={fuller:g}"
    raise InputError(problem, where="recording.every", hint=hint)


def _usable_steps(parts: Sequence[Episode]) -> Iterator[float]:
    for part in parts:
        with said_of(part.name):
            yield _usable_step(part.recording)


def _fill_in_beside(
    values: NDArray[np.float64], recording: Recording, clock: NDArray[np.float64], gap: float
) -> list[str]:
    """Interpolate, in place, sensors that have hardly a sample on the clock; return their names."""
    if not np.isnan(values).any():
        return []
    between = _interpolated(recording, clock, gap)
    known, possible = ((~np.isnan(found)).sum(axis=0) for found in (values, between))
    beside = known < BESIDE * possible
    values[:, beside] = between[:, beside]
    return [name for name, so in zip(recording.names, beside, strict=True) if so]


def _clock(times: NDArray[np.float64], own: float, step: float) -> NDArray[np.float64]:
    if step < own * (1 - ON_CLOCK):
        problem = f"a step of {step:g} is shorter than the recording's own, {own:.6g}"
        hint = f"set recording.every to null or to {own:.6g} or more"
        raise InputError(problem, where="recording.every", hint=hint)
    count = int(np.floor((times[-1] - times[0]) / step + ON_CLOCK)) + 1
    if count < FEWEST_SAMPLES:
        problem = f"a step of {step:g} leaves {count} samples: at least {FEWEST_SAMPLES} are needed"
        hint = f"set recording.every to {(times[-1] - times[0]) / FEWEST_SAMPLES:.3g} or less"
        raise InputError(problem, where="recording.every", hint=hint)
    if count > MOST_SAMPLES:
        problem = f"a step of {step:.6g} from {times[0]:g} to {times[-1]:g} makes {count} samples"
        hint = f"{MOST_SAMPLES} at most: set recording.every, or mend a time that lies far off"
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
    return values


def _between(
    times: NDArray[np.float64], values: NDArray[np.float64], at: NDArray[np.float64], gap: float
) -> NDArray[np.float64]:
    """Return values between samples: cubic through the nearest four, or linear, ``(at,)``.

    Lagrange's cubic errs by O(Δt⁴), a line by O(Δt²): at 16 samples a period that is a percent of
    what is measured, which a fit would take for physics. A line it is where the four reach across a
    gap, and where they stand so unevenly that the cubic would make their noise larger.
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
    well = (np.diff(t, axis=1).max(axis=1) <= gap) & ((weights**2).sum(axis=1) <= NOISIER)
    found[well] = (weights[well] * values[nearest[well]]).sum(axis=1)
    return found


def _missing(share: float) -> str:
    return f", {share:.1%} of the values missing" if share else ""
