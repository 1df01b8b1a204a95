"""The recording itself: its clock, what is missing, what is repeated, its noise."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.core.units import with_unit
from dashred.data.io.missing_sentinels import sentinel_counts
from dashred.data.noise_level import noise_std
from dashred.data.recording import Recording
from dashred.data.resampling import MAX_GAP, native_step
from dashred.data.time_scale import SAMPLES_PER_PERIOD, samples_per_change, suggested_step
from dashred.pipeline.check.context import CheckContext
from dashred.pipeline.check.remark import Remark, counted, doubtful, some

# Steps that differ from the mean by more than this share make a clock irregular.
IRREGULAR = 0.05
# So many gaps are no interruptions, but samples that stand unevenly.
MANY_GAPS = 5
# Of a trace: a share of values that is missing, or is the same as the one before.
MANY_MISSING, MANY_REPEATED = 0.1, 0.5
# So many times as much noise as is stated, or as little.
FAR_OFF = 3.0
# A trace of more noise than this share of its std says little.
NOISY = 0.5
# Samples on the analysis clock beyond which a run gets long, and that are too few to learn from.
MANY_SAMPLES, FEW_SAMPLES = 2000, 60


def about_recording(situation: CheckContext) -> Iterator[Remark]:
    """Say what there is, then what is wrong with it."""
    recording = situation.recording
    if recording is None:
        yield from _about_none(situation)
        return
    times = recording.times
    span = f"{len(times)} samples of {counted(len(recording.sensors), 'sensor')}"
    end = with_unit(f"{times[-1]:.6g}", situation.system.units.get("t"))
    yield Remark(f"{span}, t from {times[0]:.6g} to {end}")
    if situation.others:
        yield Remark(f"That is the longest of {len(situation.others) + 1} episodes")
    every = situation.config.recording.every
    yield from _uneven(recording)
    yield from _gone_wrong(recording, every)
    estimated = _estimated_noise(recording)
    yield from _noise(recording, estimated)
    yield from _sampling(situation, recording, estimated)
    for name, other in situation.others.items():
        for remark in _gone_wrong(other, every):
            yield replace(remark, says=f"Episode {name}: {remark.says}")


def _gone_wrong(recording: Recording, every: float | None) -> Iterator[Remark]:
    yield from _gaps(recording, every)
    yield from _missing(recording)
    yield from _marks(recording)
    yield from _repeated(recording)


def _about_none(situation: CheckContext) -> Iterator[Remark]:
    asked = situation.config.recording
    count = len(situation.split.tested.sensors) + len(situation.sensors)
    reads, noise = ", ".join(asked.reads), f"{asked.noise:.0%} noise"
    yield Remark(
        "There is no recording yet: the simulator is checked, and a layout of "
        f"{counted(count, 'sensor')} as it is asked for, reading {reads}: {noise}, "
        f"{situation.clock}. A recording of your own is recording.path=FILE"
    )


def _uneven(recording: Recording) -> Iterator[Remark]:
    step, steps = native_step(recording.times), np.diff(recording.times)
    usual = steps[steps <= MAX_GAP * step]
    if usual.size and np.abs(usual / step - 1).max() > IRREGULAR:
        shortest, longest = f"{usual.min():.4g}", f"{usual.max():.4g}"
        yield doubtful(
            f"The steps differ, from {shortest} to {longest}: values are interpolated in between",
            "recording.every=STEP sets the clock that they are brought to",
        )


def _gaps(recording: Recording, every: float | None) -> Iterator[Remark]:
    step, steps = native_step(recording.times), np.diff(recording.times)
    step = max(step, every or 0.0)
    gaps = np.flatnonzero(steps > MAX_GAP * step)
    if not gaps.size:
        return
    worst = int(gaps[steps[gaps].argmax()])
    anew = "if the system was started anew in it, its parts are episodes"
    bridged = f"a longer step bridges short ones: recording.every={MAX_GAP * step:.3g}"
    yield doubtful(
        f"{counted(gaps.size, 'gap')} longer than {MAX_GAP:g} steps; the longest, "
        f"{steps[worst]:.4g}, begins at t = {recording.times[worst]:.6g}",
        f"nothing is read into a gap; {anew if gaps.size < MANY_GAPS else bridged}",
    )


def _missing(recording: Recording) -> Iterator[Remark]:
    missing = np.isnan(recording.values).mean(axis=0)
    if not missing.any():
        return
    yield Remark(f"{missing.mean():.1%} of the values are missing")
    many = [n for n, share in zip(recording.names, missing, strict=True) if share > MANY_MISSING]
    if many:
        says = f"More than {MANY_MISSING:.0%} of their values are missing: {some(many)}"
        yield doubtful(says, "take a sensor out that hardly ever reads")


def _marks(recording: Recording) -> Iterator[Remark]:
    for name, values in zip(recording.names, recording.values.T, strict=True):
        for number, count in sentinel_counts(values).items():
            times = recording.times[values == number]
            yield doubtful(
                f"{name} reads {number:g} {count} times, first at t = {times[0]:.6g}, and nothing "
                "else near it: a mark of a missing value?",
                "leave such cells empty: as a number it is fitted like any other",
            )


def _repeated(recording: Recording) -> Iterator[Remark]:
    stuck = []
    for name, values in zip(recording.names, recording.values.T, strict=True):
        known = values[~np.isnan(values)]
        if len(known) > 1 and (np.diff(known) == 0).mean() > MANY_REPEATED:
            stuck.append(name)
    if stuck:
        yield doubtful(
            f"Most values are the same as the one before: {some(stuck)}",
            "stuck, coarsely rounded, or sampled more often than it was measured "
            "(recording.every=STEP thins it)",
        )
    seen: dict[bytes, str] = {}
    for name, values in zip(recording.names, recording.values.T, strict=True):
        twin = seen.setdefault(np.nan_to_num(values).tobytes(), name)
        if twin != name:
            yield doubtful(f"{twin} and {name} read the very same values", "is one of them a copy?")


def _estimated_noise(recording: Recording, every: int = 1) -> NDArray[np.float64]:
    """Return σ of every sensor as third differences tell it, ``(sensor,)``; NaN if they do not.

    Args:
        recording: whose stated noise has no part in it.
        every: of the values that each sensor has, so many of them: all, or every second one.
    """
    found = []
    for sensor, values in zip(recording.sensors, recording.values.T, strict=True):
        kept = np.flatnonzero(~np.isnan(values))[::every]
        bare = (replace(sensor, std=None),)
        try:
            alone = Recording(bare, recording.times[kept], values[kept, None])
            found.append(float(noise_std(alone)[0]))
        except InputError:
            found.append(math.nan)
    return np.array(found)


def _noise(recording: Recording, estimated: NDArray[np.float64]) -> Iterator[Remark]:
    varies = recording.trace_std()
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = estimated / varies
    known = shares[np.isfinite(shares)]
    if known.size:
        sizes = dict.fromkeys(f"{100 * float(x):.2g}" for x in (known.min(), known.max()))
        yield Remark(f"The noise looks like {' to '.join(sizes)} % of what the sensors vary")
    names = recording.names
    noisy = [n for n, share in zip(names, shares, strict=True) if share > NOISY]
    if noisy:
        says = "More than half of what they vary is noise, or changes from sample to sample: "
        yield doubtful(says + some(noisy), "are they sampled too slowly for what they follow?")
    for sensor, sigma in zip(recording.sensors, estimated, strict=True):
        if sensor.std is not None and sigma > FAR_OFF * sensor.std:
            says = f"{sensor.name}: its std is stated as {sensor.std:.3g}, but it scatters by "
            yield doubtful(f"{says}{sigma:.3g}", "leave std empty to have it estimated")


def _sampling(
    situation: CheckContext, recording: Recording, estimated: NDArray[np.float64]
) -> Iterator[Remark]:
    lags = samples_per_change(recording, np.nan_to_num(estimated))
    yield Remark(f"The analysis clock: {situation.clock}")
    if situation.config.recording.every is None and lags:
        fastest = min(lags, key=lambda name: lags[name])
        step = suggested_step(recording, lags)
        if step is not None and step >= 4 * native_step(recording.times):
            yield doubtful(
                f"It is sampled finely: the fastest sensor, {fastest}, takes {lags[fastest]} "
                f"samples for a {SAMPLES_PER_PERIOD}th of its period",
                f"recording.every={step:g} loses little and makes a run faster",
            )
    count = len(situation.times)
    if count > MANY_SAMPLES:
        yield doubtful(f"{count} samples make a run long", "recording.every=STEP thins them")
    elif count < FEW_SAMPLES:
        yield doubtful(f"{count} samples are few to find a law from", "record longer, or finer")
    yield _correlation(recording, lags)


def _correlation(recording: Recording, lags: dict[str, int]) -> Remark:
    """Compare the noise at every and at every second sample: white noise is as large at both."""
    fine = recording.select([name for name, lag in lags.items() if lag >= 8])
    ratios = _estimated_noise(fine) / _estimated_noise(fine, every=2)
    told = np.isfinite(ratios)
    if not told.any():
        says = "Whether its noise is correlated cannot be told at this step"
        return Remark(f"{says}: a run tells it by what its fit leaves")
    ratio = float(np.median(ratios[told]))
    fewest = (~np.isnan(fine.values[:, told])).sum(axis=0).min()
    if ratio > 1 - 4 / math.sqrt(fewest):
        return Remark("Its noise looks independent from sample to sample")
    return doubtful(
        f"Its noise looks correlated: every second sample scatters {1 / ratio:.2g} times as much",
        "a run estimates the correlation and counts such samples for less",
    )
