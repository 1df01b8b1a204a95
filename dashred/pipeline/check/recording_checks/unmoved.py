"""Sensors that nothing has reached yet, as those in front of a wave."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from dashred.data.recording import Recording
from dashred.pipeline.check.remark import Remark, shortened

# A sensor in front of a wave varies by less than this share of the largest variation of a sensor
# that reads the same quantity, and its noise is more than this share of its variation.
SMALL, NOISY = 0.1, 0.5
# Shares of the changes from one reading to the next that are zero, and of those at one value.
REPEATED, AT_ONE_VALUE = 0.5, 0.9
MOVED = "they then show only that. Otherwise they may be stuck or disconnected"


def unmoved(recording: Recording, noise: NDArray[np.float64]) -> list[str]:
    """Return the sensors that read nothing but noise, while one of the same quantity moves.

    Args:
        recording: the samples.
        noise: σ of each sensor from its own readings, ``(sensor,)``; NaN where it is constant.
    """
    std = recording.trace_std()
    least = SMALL * _largest_alike(recording, std)
    is_noise = (std == 0) | (np.nan_to_num(noise) > NOISY * std)
    found = zip(recording.names, is_noise & (std < least), strict=True)
    return [name for name, is_unmoved in found if is_unmoved]


def resting(recording: Recording) -> dict[str, float]:
    """Return the sensors that stay at one value for most of the record, and that value.

    They have it at first, or share it with a sensor of the same quantity: one that is stuck stays
    at a value of its own. Another sensor of the same quantity moves.
    """
    std = recording.trace_std()
    alike = _largest_alike(recording, std)
    found: dict[str, float] = {}
    firsts: set[str] = set()
    for sensor, values, largest in zip(recording.sensors, recording.values.T, alike, strict=True):
        known = values[~np.isnan(values)]
        repeats = known[1:][np.diff(known) == 0]
        if largest == 0 or len(repeats) <= REPEATED * (len(known) - 1):
            continue
        levels, counts = np.unique(repeats, return_counts=True)
        if counts.max() > AT_ONE_VALUE * len(repeats):
            found[sensor.name] = float(levels[counts.argmax()])
            if known[0] == found[sensor.name]:
                firsts.add(sensor.name)
    reads = {sensor.name: sensor.reads for sensor in recording.sensors}
    levels_of = [(reads[name], level) for name, level in found.items()]
    return {
        name: level
        for name, level in found.items()
        if name in firsts or levels_of.count((reads[name], level)) > 1
    }


def unmoved_remarks(
    recording: Recording, names: list[str], rests: Mapping[str, float]
) -> Iterator[Remark]:
    """Describe sensors that nothing has reached, or that rest for most of the record.

    Args:
        recording: the samples.
        names: sensors that :func:`unmoved` found.
        rests: sensors that :func:`resting` found.
    """
    std = dict(zip(recording.names, recording.trace_std(), strict=True))
    still = [name for name in names if std[name] == 0]
    noise = [name for name in names if std[name] > 0]
    late = [name for name in rests if name not in names]
    hint = f"this is correct if nothing (no wave, for example) has reached them yet: {MOVED}"
    if still:
        yield Remark(f"Constant throughout: {shortened(still)}", hint=hint)
    if noise:
        yield Remark(f"Nothing but noise throughout: {shortened(noise)}", hint=hint)
    if late:
        rest = "this is correct if they are at rest during that time; otherwise they may be stuck"
        yield Remark(f"At one value for most of the record: {shortened(late)}", hint=rest)


def _largest_alike(recording: Recording, std: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the largest std of the sensors that read the same quantity, ``(sensor,)``."""
    reads = np.array([sensor.reads for sensor in recording.sensors])
    return np.array([std[reads == own].max() for own in reads])
