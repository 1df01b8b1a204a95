"""All remarks on a recording."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dashred.core.formatting import plural
from dashred.core.units import with_unit
from dashred.data.recording import Recording
from dashred.pipeline.check.context import CheckContext
from dashred.pipeline.check.recording_checks.gaps import (
    gap_remarks,
    interruption_remarks,
    irregular_step_remarks,
)
from dashred.pipeline.check.recording_checks.noise import estimated_noise, noise_remarks
from dashred.pipeline.check.recording_checks.sampling import sampling_remarks
from dashred.pipeline.check.recording_checks.saturation import saturated
from dashred.pipeline.check.recording_checks.values import (
    missing_remarks,
    repeated_remarks,
    sentinel_remarks,
)
from dashred.pipeline.check.remark import Remark, shortened

NUMBERS = re.compile(r"[\d.]+")


def recording_remarks(context: CheckContext) -> Iterator[Remark]:
    """Describe the recording, then warn of its defects."""
    recording = context.recording
    if recording is None:
        yield from _no_recording(context)
        return
    times = recording.times
    span = f"{len(times)} samples of {plural(len(recording.sensors), 'sensor')}"
    end = with_unit(f"{times[-1]:.6g}", context.system.units.get("t"))
    yield Remark(f"{span}, t from {times[0]:.6g} to {end}")
    if context.others:
        yield Remark(f"This is the longest of {len(context.others) + 1} episodes")
    every = context.config.recording.every
    # The readings of an ODE are compared at their own times.
    is_moved = bool(context.system.axes) or every is not None
    if is_moved:
        yield from irregular_step_remarks(recording)
    episodes = {"": recording, **context.others}
    yield from _defects(recording, every, is_moved, _clocks(episodes, ""))
    estimated = estimated_noise(recording)
    yield from noise_remarks(recording, estimated)
    yield from sampling_remarks(context, recording, estimated)
    yield from _by_episode(
        (name, remark)
        for name, other in context.others.items()
        for remark in _defects(other, every, is_moved, _clocks(episodes, name))
    )


def _by_episode(remarks: Iterable[tuple[str, Remark]]) -> Iterator[Remark]:
    """Yield one remark for all episodes with the same one, up to its numbers.

    Args:
        remarks: with the name of the episode of each.
    """
    alike: dict[tuple[str, str | None], list[tuple[str, Remark]]] = {}
    for name, remark in remarks:
        key = NUMBERS.sub("#", remark.text), remark.hint
        alike.setdefault(key, []).append((name, remark))
    for (first, remark), *others in alike.values():
        text = f"Episode {first}: {remark.text}"
        if others:
            further = shortened([name for name, _ in others])
            text += f"; similarly in {plural(len(others), 'further episode')}, {further}"
        yield replace(remark, text=text)


def _clocks(episodes: Mapping[str, Recording], besides: str) -> list[NDArray[np.float64]]:
    """Return the times of all episodes but one."""
    return [episode.times for name, episode in episodes.items() if name != besides]


def _defects(
    recording: Recording,
    every: float | None,
    is_moved: bool,
    others: Sequence[NDArray[np.float64]],
) -> Iterator[Remark]:
    """Describe the defects.

    Args:
        recording: one episode.
        every: step of the analysis clock, if it is stated.
        is_moved: whether the samples are moved to a clock.
        others: times of the other episodes.
    """
    if is_moved:
        yield from gap_remarks(recording, every)
    else:
        yield from interruption_remarks(recording, others)
    yield from missing_remarks(recording)
    yield from sentinel_remarks(recording)
    yield from repeated_remarks(recording)
    yield from saturated(recording)


def _no_recording(context: CheckContext) -> Iterator[Remark]:
    asked = context.config.recording
    count = len(context.split.tested.sensors) + len(context.sensors)
    reads, noise = ", ".join(asked.reads), f"{asked.noise:.0%} noise"
    yield Remark(
        "There is no recording yet: the check uses the simulator and the configured layout of "
        f"{plural(count, 'sensor')} of {reads} ({noise}, {context.clock}). "
        "Name a recording with recording.path=FILE"
    )
