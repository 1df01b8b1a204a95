"""What every recording must satisfy, from whichever file it was read."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor

# Fewer samples than this fill neither a lagged window nor a fit and a held-out part.
FEWEST_SAMPLES = 20
# Larger numbers are marks of a missing value, or damage; their squares would not be finite.
LARGEST = 1e100

# Where a sample (and a sensor's value in it) stands in the file.
Place = Callable[[int, str | None], str]


def checked_recording(
    sensors: Sequence[Sensor],
    times: NDArray[np.float64],
    values: NDArray[np.float64],
    *,
    path: str,
    place: Place,
) -> Recording:
    """Return the recording of times (time,) and values (time, sensor) after checking both.

    Raises:
        InputError: for too few samples, times that are missing or do not increase, infinite
            values, or a sensor without any value.
    """
    if not sensors:
        raise InputError("the recording has no sensor", where=path)
    if len(times) < FEWEST_SAMPLES:
        problem = f"{len(times)} samples are too few: at least {FEWEST_SAMPLES} are needed"
        raise InputError(problem, where=path)
    _check_times(times, place)
    _check_values([sensor.name for sensor in sensors], values, path, place)
    return Recording(tuple(sensors), times, values)


def check_input(
    name: str, column: str, values: NDArray[np.float64], place: Callable[[int, str], str]
) -> None:
    """Refuse an input (sample,) that is not known at each of its samples.

    Raises:
        InputError: at the first value that is missing, infinite, or too large to be one.
    """
    bad = np.flatnonzero(~(np.abs(values) <= LARGEST))
    if not bad.size:
        return
    found, where = float(values[bad[0]]), place(int(bad[0]), column)
    if found != found:
        problem = f"the input {name} is missing here; between samples it is a straight line"
        raise InputError(problem, where=where, hint="leave the whole row out, or fill the gap")
    size = "infinite" if np.isinf(found) else f"beyond {LARGEST:g}"
    problem = f"the input {name} is {size} here"
    raise InputError(problem, where=where, hint="leave the whole row out, or mend the value")


def check_covered(times: NDArray[np.float64], driven: NDArray[np.float64], where: str) -> None:
    """Refuse inputs on a clock (sample,) that begins after the recording's times, or ends before.

    Raises:
        InputError: saying until when they are known.
    """
    spare = 1e-9 * max(float(np.abs(times).max()), float(times[-1] - times[0]))
    if driven[0] <= times[0] + spare and driven[-1] >= times[-1] - spare:
        return
    problem = (
        f"the inputs are known from {driven[0]:.6g} to {driven[-1]:.6g}, and the samples go from "
        f"{times[0]:.6g} to {times[-1]:.6g}"
    )
    hint = "what drove the system must be known all the time: leave the other samples out"
    raise InputError(problem, where=where, hint=hint)


def _check_times(times: NDArray[np.float64], place: Place) -> None:
    bad = np.flatnonzero(~np.isfinite(times))
    if bad.size:
        problem = "the time is missing or not finite"
        hint = "every sample needs its time"
        raise InputError(problem, where=place(int(bad[0]), "time"), hint=hint)
    far = np.flatnonzero(np.abs(times) > LARGEST)
    if far.size:
        problem = f"the time is beyond {LARGEST:g}"
        raise InputError(problem, where=place(int(far[0]), "time"))
    late = np.flatnonzero(times[1:] <= times[:-1])
    if late.size:
        row = int(late[0]) + 1
        fault = "is repeated" if times[row] == times[row - 1] else "goes back"
        problem = f"time {fault}: {times[row]:.10g} after {times[row - 1]:.10g}"
        hint = "times must increase from sample to sample"
        raise InputError(problem, where=place(row, "time"), hint=hint)


def _check_values(
    names: Sequence[str], values: NDArray[np.float64], path: str, place: Place
) -> None:
    infinite = np.argwhere(np.isinf(values))
    if infinite.size:
        row, column = (int(index) for index in infinite[0])
        hint = "leave the cell empty where a value is missing"
        raise InputError("the value is infinite", where=place(row, names[column]), hint=hint)
    large = np.argwhere(np.abs(values) > LARGEST)
    if large.size:
        row, column = (int(index) for index in large[0])
        hint = "leave the cell empty where a value is missing"
        problem = f"the value is beyond {LARGEST:g}"
        raise InputError(problem, where=place(row, names[column]), hint=hint)
    for name, column in zip(names, values.T, strict=True):
        if np.isnan(column).all():
            problem = f"sensor {name!r} has no value at all"
            raise InputError(problem, where=path, hint="take it out of the recording")
