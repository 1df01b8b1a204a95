"""Validation of recordings, shared by all file formats."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor

# All episodes together need at least this many samples, so that some remain for each split. What
# they suffice for shows in the intervals.
MIN_SAMPLES = 8
# An episode needs at least this many, for its fit window and its held-out end.
MIN_EPISODE_SAMPLES = 6
# A step between samples of an interpolated input that is this many times the median is a gap.
MAX_INPUT_GAP = 5.0
# If a larger share of the rows repeats a time, the table may have a row for each reading.
MANY_REPEATED = 0.1
# Larger numbers are sentinels of a missing value or damage, and their squares overflow.
MAX_ABS_VALUE = 1e100

# Returns the location in the file of a sample, or of one sensor's value in that sample.
Locate = Callable[[int, str | None], str]


def checked_recording(
    sensors: Sequence[Sensor],
    times: NDArray[np.float64],
    values: NDArray[np.float64],
    *,
    path: str,
    place: Locate,
    fewest: int = MIN_SAMPLES,
) -> Recording:
    """Return a recording after checking its times and values.

    Args:
        sensors: one for each column of ``values``.
        times: shape ``(time,)``.
        values: shape ``(time, sensor)``; NaN where a value is missing.
        path: the file, for error messages.
        place: returns the location of a sample for error messages.
        fewest: smallest number of samples (:func:`fewest_samples`).

    Raises:
        InputError: for too few samples, times that are missing or do not increase, infinite
            values, or a sensor without any value.
    """
    if not sensors:
        raise InputError("the recording has no sensors", where=path)
    if len(times) < fewest:
        problem = f"{len(times)} samples are too few: at least {fewest} are needed"
        raise InputError(problem, where=path)
    _check_times(times, place)
    _check_values([sensor.name for sensor in sensors], values, path, place)
    return Recording(tuple(sensors), times, values)


def fewest_samples(counts: Sequence[int]) -> int:
    """Return how many samples an episode needs, given the number of samples of all episodes."""
    return MIN_EPISODE_SAMPLES if sum(counts) >= MIN_SAMPLES else MIN_SAMPLES


def check_input(
    name: str, column: str, values: NDArray[np.float64], place: Callable[[int, str], str]
) -> None:
    """Check that the values of an input are known, and plausible.

    Args:
        name: of the input in the equations.
        column: of the input in the recording.
        values: shape ``(sample,)``.
        place: returns the location of a sample for error messages.

    Raises:
        InputError: at the first value that is missing, infinite, or implausibly large.
    """
    bad = np.flatnonzero(~(np.abs(values) <= MAX_ABS_VALUE))
    if not bad.size:
        return
    found, where = float(values[bad[0]]), place(int(bad[0]), column)
    if found != found:
        problem = f"the input {name} is missing here"
        hint = "fill the gap, or remove the sample"
        raise InputError(problem, where=where, hint=hint)
    size = "infinite" if np.isinf(found) else f"beyond {MAX_ABS_VALUE:g}"
    problem = f"the input {name} is {size} here"
    raise InputError(problem, where=where, hint="correct the value, or remove the row")


def check_gaps(
    times: NDArray[np.float64],
    values: NDArray[np.float64],
    samples: NDArray[np.float64],
    where: str,
) -> None:
    """Check that an input that is interpolated is not empty for long between the samples.

    Args:
        times: of the rows, increasing, ``(row,)``.
        values: of the input, ``(row,)``; NaN where its cell is empty. One at least is known.
        samples: times of the samples that are used, increasing, ``(sample,)``.
        where: location for error messages.

    Raises:
        InputError: a step between samples with empty cells is much longer than most steps are.
    """
    known = np.flatnonzero(~np.isnan(values))
    steps = np.diff(times[known])
    if not len(steps):
        return
    long = (np.diff(known) > 1) & (steps > MAX_INPUT_GAP * np.median(steps))
    long &= (times[known[:-1]] < samples[-1]) & (times[known[1:]] > samples[0])
    if not long.any():
        return
    first = int(np.argmax(long))
    begin, end = times[known[first]], times[known[first + 1]]
    problem = f"the input has no value between {begin:.6g} and {end:.6g}"
    hint = (
        "fill the gap; or take a part without it, with recording.begin and recording.end (begin= "
    )
    hint += "and end= for dashred init); or name the parts before and after it in a column "
    hint += "'episode'; if its values hold until they change, set hold: true for this input"
    raise InputError(problem, where=where, hint=hint)


def check_covered(times: NDArray[np.float64], input_times: NDArray[np.float64], where: str) -> None:
    """Check that the inputs cover the whole recording.

    Args:
        times: of the recording's samples, shape ``(time,)``.
        input_times: of the inputs' samples, shape ``(sample,)``.
        where: location for error messages.

    Raises:
        InputError: the inputs begin after the recording or end before it.
    """
    tolerance = 1e-9 * max(float(np.abs(times).max()), float(times[-1] - times[0]))
    if input_times[0] <= times[0] + tolerance and input_times[-1] >= times[-1] - tolerance:
        return
    problem = (
        f"the inputs cover {input_times[0]:.6g} to {input_times[-1]:.6g}, but the samples run from "
        f"{times[0]:.6g} to {times[-1]:.6g}"
    )
    bounds = []
    if input_times[0] > times[0] + tolerance:
        bounds.append(f"begin={input_times[0]:.9g}")
    if input_times[-1] < times[-1] - tolerance:
        bounds.append(f"end={input_times[-1]:.9g}")
    named = " ".join(f"recording.{bound}" for bound in bounds)
    hint = f"leave out the samples without them: {named}, or {' '.join(bounds)} for dashred init"
    raise InputError(problem, where=where, hint=hint)


def _check_times(times: NDArray[np.float64], place: Locate) -> None:
    bad = np.flatnonzero(~np.isfinite(times))
    if bad.size:
        problem = "the time is missing or not finite"
        hint = "every sample needs a time"
        raise InputError(problem, where=place(int(bad[0]), "time"), hint=hint)
    far = np.flatnonzero(np.abs(times) > MAX_ABS_VALUE)
    if far.size:
        problem = f"the time is beyond {MAX_ABS_VALUE:g}"
        raise InputError(problem, where=place(int(far[0]), "time"))
    not_increasing = np.flatnonzero(times[1:] <= times[:-1])
    if not_increasing.size:
        row = int(not_increasing[0]) + 1
        fault = "is repeated" if times[row] == times[row - 1] else "decreases"
        problem = f"time {fault}: {times[row]:.10g} after {times[row - 1]:.10g}"
        hint = "times must increase from each sample to the next"
        if times[row] == times[row - 1]:
            count = int((times[1:] == times[:-1]).sum())
            rows = "this row repeats" if count == 1 else f"{count} rows repeat"
            hint += f"; {rows} the time of the row before: keep one row for each time"
            if count > MANY_REPEATED * len(times):
                hint += ", or tell the rows of one time apart: "
                hint += "recording.columns={sensor: COLUMN, value: COLUMN}, or {x: COLUMN}"
        else:
            hint += "; if the clock was started again, name the runs in a column 'episode'"
        raise InputError(problem, where=place(row, "time"), hint=hint)


def _check_values(
    names: Sequence[str], values: NDArray[np.float64], path: str, place: Locate
) -> None:
    infinite = np.argwhere(np.isinf(values))
    if infinite.size:
        row, column = (int(index) for index in infinite[0])
        hint = "leave the cell empty where a value is missing"
        raise InputError("the value is infinite", where=place(row, names[column]), hint=hint)
    large = np.argwhere(np.abs(values) > MAX_ABS_VALUE)
    if large.size:
        row, column = (int(index) for index in large[0])
        hint = "leave the cell empty where a value is missing"
        problem = f"the value is beyond {MAX_ABS_VALUE:g}"
        raise InputError(problem, where=place(row, names[column]), hint=hint)
    if np.isnan(values).all():
        what = f"sensor {names[0]!r} has" if len(names) == 1 else "the sensors have"
        hint = "remove it from the recording" if len(names) == 1 else "remove the episode"
        raise InputError(f"{what} no values", where=path, hint=hint)
