"""Checks of the recording: its clock, missing and repeated values, and its noise."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.core.units import with_unit
from dashred.data.clocks.interruptions import interruptions
from dashred.data.clocks.resampling import MAX_GAP, native_step
from dashred.data.clocks.time_scale import (
    SAMPLES_PER_PERIOD,
    lost_change,
    samples_per_change,
    step_that_keeps,
    suggested_step,
)
from dashred.data.fast_signals import is_fast
from dashred.data.io.missing_sentinels import mask_sentinels, sentinel_counts
from dashred.data.noise_level import noise_std
from dashred.data.recording import Recording
from dashred.pipeline.check.context import CheckContext
from dashred.pipeline.check.remark import Remark, plural, shortened, warning
from dashred.pipeline.check.saturation import saturated
from dashred.pipeline.check.unmoved import resting, unmoved, unmoved_remarks

# Relative deviation from the mean step above which a clock is irregular.
IRREGULAR = 0.05
# An interval longer than this many steps is a gap if the samples keep their times.
MAX_GAP_KEPT = 10.0
# With this many gaps the sampling is uneven rather than interrupted.
MANY_GAPS = 5
RESTARTED = "if the system was restarted there, declare the parts as episodes"
# Shares of missing values, and of values equal to the previous one, that cause a warning.
MANY_MISSING, MANY_REPEATED = 0.1, 0.5
# Estimated over stated noise that causes a warning.
MAX_NOISE_RATIO = 3.0
# Noise over standard deviation of a trace that causes a warning.
NOISY = 0.5
# Below this share the last digits of a number make the noise.
NO_NOISE = 1e-5
# Numbers of samples on the analysis clock that are many, and that are few.
MANY_SAMPLES, FEW_SAMPLES = 2000, 60


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
        yield from _irregular_steps(recording)
    episodes = {"": recording, **context.others}
    yield from _defects(recording, every, is_moved, _clocks(episodes, ""))
    estimated = _estimated_noise(recording)
    yield from _noise_remarks(recording, estimated)
    yield from _sampling_remarks(context, recording, estimated)
    for name, other in context.others.items():
        for remark in _defects(other, every, is_moved, _clocks(episodes, name)):
            yield replace(remark, text=f"Episode {name}: {remark.text}")


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
        yield from _gaps(recording, every)
    else:
        yield from _interruptions(recording, others)
    yield from _missing(recording)
    yield from _sentinels(recording)
    yield from _repeated(recording)
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


def _irregular_steps(recording: Recording) -> Iterator[Remark]:
    step, steps = native_step(recording.times), np.diff(recording.times)
    usual = steps[steps <= MAX_GAP * step]
    if usual.size and np.abs(usual / step - 1).max() > IRREGULAR:
        shortest, longest = f"{usual.min():.4g}", f"{usual.max():.4g}"
        yield warning(
            f"The time steps vary from {shortest} to {longest}: values are interpolated",
            "recording.every=STEP sets the step of the analysis clock",
        )


def _gaps(recording: Recording, every: float | None) -> Iterator[Remark]:
    """Describe intervals that a clock does not bridge."""
    longest = MAX_GAP * max(native_step(recording.times), every or 0.0)
    gaps = np.flatnonzero(np.diff(recording.times) > longest)
    if not gaps.size:
        return
    longer = f"a longer step bridges short gaps: recording.every={longest:.3g}"
    hint = RESTARTED if gaps.size < MANY_GAPS else longer
    yield _gap_warning(recording, gaps, MAX_GAP, f"gaps are not interpolated; {hint}")


def _interruptions(recording: Recording, others: Sequence[NDArray[np.float64]]) -> Iterator[Remark]:
    """Describe interruptions; many of them are an uneven sampling."""
    step = native_step(recording.times)
    gaps = interruptions(recording.times, MAX_GAP_KEPT * step, others)
    if 0 < gaps.size < MANY_GAPS:
        yield _gap_warning(recording, gaps, MAX_GAP_KEPT, RESTARTED)


def _gap_warning(recording: Recording, gaps: NDArray[np.intp], longer: float, hint: str) -> Remark:
    """Return a warning of gaps, ``(gap,)`` samples, that are longer than some steps."""
    steps = np.diff(recording.times)
    worst = int(gaps[steps[gaps].argmax()])
    text = f"{plural(gaps.size, 'gap')} longer than {longer:g} steps; the longest, "
    return warning(f"{text}{steps[worst]:.4g}, starts at t = {recording.times[worst]:.6g}", hint)


def _missing(recording: Recording) -> Iterator[Remark]:
    missing = np.isnan(recording.values).mean(axis=0)
    if not missing.any():
        return
    yield Remark(f"{missing.mean():.1%} of the values are missing")
    many = [n for n, share in zip(recording.names, missing, strict=True) if share > MANY_MISSING]
    if many:
        text = f"More than {MANY_MISSING:.0%} of the values are missing from {shortened(many)}"
        yield warning(text, "remove sensors with very few values")


def _sentinels(recording: Recording) -> Iterator[Remark]:
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


def _repeated(recording: Recording) -> Iterator[Remark]:
    stuck, rests = [], resting(recording)
    yield from unmoved_remarks(recording, unmoved(recording, _estimated_noise(recording)), rests)
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


def _estimated_noise(recording: Recording, every: int = 1) -> NDArray[np.float64]:
    """Estimate σ of every sensor from third differences, ``(sensor,)``; NaN where impossible.

    Args:
        recording: the recording; its stated noise is ignored.
        every: stride over the known values of each sensor.
    """
    sigmas = []
    for sensor, values in zip(recording.sensors, recording.values.T, strict=True):
        known = np.flatnonzero(~np.isnan(values))[::every]
        unstated = (replace(sensor, std=None),)
        try:
            times = recording.times[known]
            alone = Recording(unstated, times, values[known, None], recording.inputs)
            sigmas.append(float(noise_std(alone)[0]))
        except InputError:
            sigmas.append(math.nan)
    return np.array(sigmas)


def _noise_remarks(recording: Recording, estimated: NDArray[np.float64]) -> Iterator[Remark]:
    quiet = unmoved(recording, estimated)
    varies = recording.trace_std()
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = estimated / varies
    shares[[name in quiet for name in recording.names]] = np.nan
    known = shares[np.isfinite(shares)]
    names = recording.names
    traces = zip(names, recording.values.T, strict=True)
    fast = [name for name, values in traces if is_fast(recording.times, values)]
    if known.size and known.max() < NO_NOISE:
        yield Remark("The readings show no noise")
    elif known.size:
        sizes = dict.fromkeys(f"{100 * float(x):.2g}" for x in (known.min(), known.max()))
        size = f"{' to '.join(sizes)} % of the standard deviation of the readings"
        bound = f": {shortened(fast)} may change as fast as sampled" if fast else ""
        yield Remark(f"The noise is {'at most' if fast else 'about'} {size}{bound}")
    noisy = [n for n, share in zip(names, shares, strict=True) if share > NOISY]
    if noisy:
        text = f"More than half of the variation is from sample to sample: {shortened(noisy)}"
        hint = "nothing is wrong if these sensors are quiet, or driven by something as fast; "
        yield warning(text, f"{hint}otherwise sample faster")
    for sensor, sigma in zip(recording.sensors, estimated, strict=True):
        if sensor.std is None or sensor.name in fast:
            continue
        if sigma > MAX_NOISE_RATIO * sensor.std:
            text = (
                f"{sensor.name}: the stated std is {sensor.std:.3g}, but the readings change by "
                f"{sigma:.3g} from sample to sample"
            )
            hint = "right if what is measured changes as fast; otherwise correct the std"
            yield warning(text, hint)


def _sampling_remarks(
    context: CheckContext, recording: Recording, estimated: NDArray[np.float64]
) -> Iterator[Remark]:
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
    yield _correlation_remark(recording, lags, estimated)


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


def _correlation_remark(
    recording: Recording, lags: dict[str, int], estimated: NDArray[np.float64]
) -> Remark:
    """Compare the noise of all samples and of every second one: white noise is equal in both."""
    shares = estimated / recording.trace_std()
    names = [name for name, share in zip(recording.names, shares, strict=True) if share > NO_NOISE]
    fine = recording.select([name for name in names if lags.get(name, 0) >= 8])
    ratios = _estimated_noise(fine) / _estimated_noise(fine, every=2)
    finite = np.isfinite(ratios)
    if not finite.any():
        return Remark(
            "This step is too long to tell whether the noise is correlated; a run tells it from "
            "the residuals of its fit"
        )
    ratio = float(np.median(ratios[finite]))
    fewest = (~np.isnan(fine.values[:, finite])).sum(axis=0).min()
    if ratio > 1 - 4 / math.sqrt(fewest):
        return Remark("The noise looks white")
    return warning(
        "The noise looks autocorrelated: neighbouring readings err alike",
        "a run estimates the correlation and weights the samples accordingly",
    )
