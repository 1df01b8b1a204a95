"""Whether the steps of a recording and of its analysis clock suit its changes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dashred.data.clocks.resampling import native_step
from dashred.data.clocks.time_scale import (
    SAMPLES_PER_PERIOD,
    lost_change,
    samples_per_change,
    step_that_keeps,
    suggested_step,
)
from dashred.data.io.missing_sentinels import mask_sentinels
from dashred.data.recording import Recording
from dashred.pipeline.check.context import CheckContext
from dashred.pipeline.check.recording_checks.noise import correlation_remark
from dashred.pipeline.check.remark import Remark, warning

# Numbers of samples on the analysis clock that are many, and that are few.
MANY_SAMPLES, FEW_SAMPLES = 2000, 60


def sampling_remarks(
    context: CheckContext, recording: Recording, estimated: NDArray[np.float64]
) -> Iterator[Remark]:
    """Describe the analysis clock, and warn of steps that do not suit the recording.

    Args:
        context: of the check.
        recording: the longest episode.
        estimated: σ of each sensor, as returned by :func:`.noise.estimated_noise`.
    """
    stated = [sensor.std for sensor in recording.sensors]
    noise = np.array([s if s is not None else e for s, e in zip(stated, estimated, strict=True)])
    noise = np.nan_to_num(noise)
    lags = samples_per_change(recording, noise)
    yield Remark(f"Analysis clock: {context.clock}")
    if context.config.recording.every is None and lags:
        fastest = min(lags, key=lambda name: lags[name])
        step = suggested_step(recording, lags, noise)
        if step is not None and step >= 4 * native_step(recording.times):
            yield warning(
                f"The sampling is finer than needed: the fastest sensor, {fastest}, has "
                f"{lags[fastest]} samples in a {SAMPLES_PER_PERIOD}th of its period",
                f"recording.every={step:g} loses little and makes a run faster",
            )
    count = len(context.times) + sum(len(other.times) for other in context.others.values())
    if len(context.times) > MANY_SAMPLES:
        slow = f"{len(context.times)} samples make a run slow"
        hint = "set a longer step that still shows the fastest change, recording.every=STEP, or "
        hint += "take a part, recording.end=TIME"
        yield warning(slow, hint)
    elif count < FEW_SAMPLES:
        yield warning(
            f"{count} samples are few for finding a law", "record longer or at a shorter step"
        )
    if context.system.axes or context.config.recording.every is not None:
        # A number that marks missing values is no change.
        known = replace(recording, values=mask_sentinels(recording.values))
        yield from _lost_changes(known, noise, native_step(context.times.numpy()))
    yield correlation_remark(recording, lags, estimated)


def _lost_changes(
    recording: Recording, noise: NDArray[np.float64], step: float
) -> Iterator[Remark]:
    """Warn of a change that the analysis clock leaves out.

    Args:
        recording: the samples.
        noise: σ of each sensor, ``(sensor,)``.
        step: of the analysis clock.
    """
    if (
        step < 1.5 * native_step(recording.times)
        or (lost := lost_change(recording, noise, step)) is None
    ):
        return
    shorter = step_that_keeps(recording, noise, step)
    every = "null" if shorter is None else f"{shorter:g}"
    yield warning(
        f"{lost[0]} changes faster near t = {lost[1]:.6g} than the analysis clock can show",
        f"recording.every={every} keeps the change, unless it is a fault of the sensor: the "
        "fastest response may show only there",
    )
