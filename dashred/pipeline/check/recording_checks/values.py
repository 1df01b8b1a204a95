"""Missing values of a recording, numbers that may mark them, and repeated values."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from dashred.data.io.missing_sentinels import sentinel_counts
from dashred.data.recording import Recording
from dashred.pipeline.check.recording_checks.noise import estimated_noise
from dashred.pipeline.check.recording_checks.unmoved import resting, unmoved, unmoved_remarks
from dashred.pipeline.check.remark import Remark, shortened, warning

# Shares of missing values, and of values equal to the previous one, that cause a warning.
MANY_MISSING, MANY_REPEATED = 0.1, 0.5
# Sensors that are read in turn lack no more values at a time than this, on average.
AT_A_TIME = 4


def missing_remarks(recording: Recording) -> Iterator[Remark]:
    """Say how many values are missing, and warn of sensors that lack many in a row."""
    missing = np.isnan(recording.values).mean(axis=0)
    if not missing.any():
        return
    # Other episodes have values of these sensors.
    unread = [name for name, share in zip(recording.names, missing, strict=True) if share == 1]
    if unread:
        yield Remark(f"No values of {shortened(unread)}")
    if (missing[missing < 1] > 0).any():
        yield Remark(f"{missing[missing < 1].mean():.1%} of the values are missing")
    many = [
        name
        for name, share, column in zip(recording.names, missing, recording.values.T, strict=True)
        if MANY_MISSING < share < 1 and not _is_read_in_turn(column)
    ]
    if many:
        text = f"More than {MANY_MISSING:.0%} of the values are missing from {shortened(many)}"
        yield warning(text, "remove sensors with very few values")


def _is_read_in_turn(values: NDArray[np.float64]) -> bool:
    """Tell whether a sensor lacks only a few values at a time, as if others are read between."""
    missing = np.isnan(values)
    runs = int(np.diff(missing, prepend=False).sum() + missing[-1]) / 2
    return runs * AT_A_TIME >= float(missing.sum())


def sentinel_remarks(recording: Recording) -> Iterator[Remark]:
    """Warn of numbers that may mark missing values."""
    for name, values in zip(recording.names, recording.values.T, strict=True):
        for number, count in sentinel_counts(values).items():
            times = recording.times[values == number]
            yield warning(
                f"{name} reads {number:g} {count} times, first at t = {times[0]:.6g}, far from its "
                "other values: this may mark missing values",
                "leave the cells of missing values empty; otherwise the number is fitted",
            )
    for name, values in recording.inputs.values.items():
        for number, count in sentinel_counts(values).items():
            yield warning(
                f"The input {name} is {number:g} {count} times, far from its other values: this "
                "may mark missing values",
                "leave the cells of missing values empty; otherwise the number drives the system",
            )


def repeated_remarks(recording: Recording) -> Iterator[Remark]:
    """Warn of sensors that repeat their values, or those of another sensor."""
    stuck, rests = [], resting(recording)
    yield from unmoved_remarks(recording, unmoved(recording, estimated_noise(recording)), rests)
    for name, values in zip(recording.names, recording.values.T, strict=True):
        known = values[~np.isnan(values)]
        if name not in rests and len(known) > 1 and (np.diff(known) == 0).mean() > MANY_REPEATED:
            stuck.append(name)
    if stuck:
        yield warning(
            f"Sensors with mostly repeated values: {shortened(stuck)}",
            "they may be stuck, at rest, coarsely rounded, or written more often than measured "
            "(recording.every=STEP sets a longer step)",
        )
    first_with: dict[bytes, str] = {}
    moves = recording.trace_std() > 0
    names = [name for name, does in zip(recording.names, moves, strict=True) if does]
    for name, values in zip(names, recording.values.T[moves], strict=True):
        first = first_with.setdefault(np.nan_to_num(values).tobytes(), name)
        if first != name:
            yield warning(f"{first} and {name} have identical values", "one may be a copy")
