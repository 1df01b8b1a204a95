"""The noise of a recording: its size, beside the stated one, and its correlation."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.data.fast_signals import is_fast
from dashred.data.noise_level import noise_std
from dashred.data.recording import Recording
from dashred.pipeline.check.recording_checks.unmoved import unmoved
from dashred.pipeline.check.remark import Remark, shortened, warning

# Estimated over stated noise that causes a warning.
MAX_NOISE_RATIO = 3.0
# Noise over standard deviation of a trace that causes a warning.
NOISY = 0.5
# Below this share the last digits of a number make the noise.
NO_NOISE = 1e-5


def estimated_noise(recording: Recording, every: int = 1) -> NDArray[np.float64]:
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


def noise_remarks(recording: Recording, estimated: NDArray[np.float64]) -> Iterator[Remark]:
    """Say how large the noise is, and warn where it is large or larger than stated.

    Args:
        recording: the samples.
        estimated: σ of each sensor, as returned by :func:`estimated_noise`.
    """
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
        bound = f"; {shortened(fast)} may change as fast as the samples are taken" if fast else ""
        yield Remark(f"The noise is {'at most' if fast else 'about'} {size}{bound}")
    noisy = [n for n, share in zip(names, shares, strict=True) if share > NOISY]
    if noisy:
        text = f"More than half of the variation is from sample to sample: {shortened(noisy)}"
        hint = "this is correct if these sensors are quiet or what drives them changes that fast"
        yield warning(text, f"{hint}; otherwise sample faster")
    for sensor, sigma in zip(recording.sensors, estimated, strict=True):
        if sensor.std is None or sensor.name in fast:
            continue
        if sigma > MAX_NOISE_RATIO * sensor.std:
            text = (
                f"{sensor.name}: the stated std is {sensor.std:.3g}, but the readings change by "
                f"{sigma:.3g} from sample to sample"
            )
            hint = "this is correct if the measured quantity changes that fast"
            yield warning(text, f"{hint}; otherwise correct the std")


def correlation_remark(
    recording: Recording, lags: dict[str, int], estimated: NDArray[np.float64]
) -> Remark:
    """Compare the noise of all samples and of every second one: white noise is equal in both."""
    shares = estimated / recording.trace_std()
    names = [name for name, share in zip(recording.names, shares, strict=True) if share > NO_NOISE]
    fine = recording.select([name for name in names if lags.get(name, 0) >= 8])
    ratios = estimated_noise(fine) / estimated_noise(fine, every=2)
    finite = np.isfinite(ratios)
    if not finite.any():
        return Remark(
            "This step is too long to tell whether the noise is correlated; a run estimates it "
            "from the residuals of its fit"
        )
    ratio = float(np.median(ratios[finite]))
    fewest = (~np.isnan(fine.values[:, finite])).sum(axis=0).min()
    if ratio > 1 - 4 / math.sqrt(fewest):
        return Remark("The noise looks white")
    return warning(
        "The noise looks autocorrelated: neighbouring readings have similar errors",
        "a run estimates the correlation and weights the samples accordingly",
    )
