"""Choose the settings of the filter, and the statistics of its innovations, on a recording."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.inference.initial_state.ensemble_filter import FilterLostError
from dashred.inference.streaming.live_estimator import LiveEstimator
from dashred.inference.streaming.whitening import Whitener

Array = NDArray[np.float64]

# The settings are chosen with so many samples at most, and the statistics are those of so many.
TRIED, MEASURED = 200, 2000
# Share of the samples, and their largest number, in which the filter finds the state.
BEGINNING, LONGEST_BEGINNING = 0.2, 50


@dataclass(frozen=True)
class Calibration:
    """The filter after a recording.

    Attributes:
        filter: with the chosen settings, after the last sample.
        innovations: whitens the innovations, in their expected standard deviations.
        serial: whitens the serial innovations.
        samples: number of samples that the statistics are from.
    """

    filter: LiveEstimator
    innovations: Whitener
    serial: Whitener
    samples: int


@dataclass(frozen=True)
class _Run:
    filter: LiveEstimator
    density: float
    innovations: Array
    serial: Array


def calibrate(filter: LiveEstimator, times: Array, values: Array) -> Calibration:
    """Choose localisation and inflation, and measure the innovations.

    The settings are those with the largest density of the readings, one after the other: radius,
    additive part, inflation.

    Args:
        filter: with any settings.
        times: of the samples, ``(time,)``.
        values: readings, ``(time, sensor)``; NaN where missing.

    Raises:
        InputError: the members blow up with all settings.
    """
    tried = slice(-TRIED, None)
    best: _Run | None = None
    for change in filter.changes:
        for value in change[1]:
            settings = filter.settings if best is None else best.filter.settings
            given = replace(settings, **{change[0]: value})
            if best is not None and given == best.filter.settings:
                continue
            run = _run(filter.with_settings(given), times[tried], values[tried])
            if run is not None and (best is None or run.density > best.density):
                best = run
    if best is not None:
        measured = slice(-MEASURED, None)
        last = _run(
            best.filter.with_settings(best.filter.settings), times[measured], values[measured]
        )
        if last is not None:
            fitted = Whitener.fit(last.innovations), Whitener.fit(last.serial)
            return Calibration(last.filter, *fitted, len(last.serial))
    raise InputError(
        "the corrected simulator cannot follow its own recording: the ensemble blows up",
        hint="use a smaller system.integrator.dt, and run the analysis again",
    )


def _run(filter: LiveEstimator, times: Array, values: Array) -> _Run | None:
    """Filter a recording; return None if the members blow up."""
    beginning = min(int(BEGINNING * len(times)), LONGEST_BEGINNING)
    limits = np.full(values.shape[1], np.inf)
    density, innovations, serial = 0.0, [], []
    spans = np.diff(times, prepend=times[0])
    try:
        for i, (time, span, sample) in enumerate(zip(times, spans, values, strict=True)):
            found = filter.step(float(time), float(span), sample, limits)
            if i >= beginning:
                density += found.density
                innovations.append(found.innovation / found.innovation_std)
                serial.append(found.serial)
    except FilterLostError:
        return None
    if not math.isfinite(density):
        return None
    return _Run(filter, density, np.array(innovations), np.array(serial))
