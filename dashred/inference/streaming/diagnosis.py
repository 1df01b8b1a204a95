"""Whether an alarm is the fault of one sensor: filter the last samples without it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dashred.inference.initial_state.ensemble_filter import FilterLostError
from dashred.inference.streaming.live_estimator import LiveEstimator
from dashred.inference.streaming.monitor import Monitor

Array = NDArray[np.float64]

# Number of samples of the history, and of the sensors that are tried.
LONGEST, SUSPECTS = 256, 3
# Without the faulty sensor, no chart is above this share of its threshold. It is below 1 because
# the samples are few.
CLEAN = 0.6
# The chart of a suspect is above this share of the threshold.
SUSPICIOUS = 0.3


@dataclass(frozen=True)
class Sample:
    """A sample of the history: its number, time, time since the sample before, and readings."""

    index: int
    time: float
    span: float
    values: Array


@dataclass(frozen=True)
class Snapshot:
    """The filter and its charts before the sample with this number."""

    index: int
    filter: LiveEstimator
    monitor: Monitor


@dataclass(frozen=True)
class Faulty:
    """The sensor without which the others are white noise, and the filter without it."""

    sensor: int
    filter: LiveEstimator
    monitor: Monitor


def without_one_sensor(
    snapshots: Sequence[Snapshot], history: Sequence[Sample], heights: Array, since: int
) -> Faulty | None:
    """Return the one sensor that explains an alarm; None if there is none.

    Args:
        snapshots: copies of the filter, in order.
        history: samples, in order.
        heights: of the chart of each sensor, in thresholds, ``(sensor,)``.
        since: number of the sample since which something has changed.
    """
    if not snapshots:
        return None
    before = [each for each in snapshots if each.index <= since]
    begin = before[-1] if before else snapshots[0]
    samples = [sample for sample in history if sample.index >= begin.index]
    highest = np.argsort(-heights)[:SUSPECTS]
    suspects = [int(each) for each in highest if heights[each] > SUSPICIOUS]
    tried = [_without(sensor, begin, samples) for sensor in suspects]
    clean = [each for each in tried if each is not None and _others(each) < CLEAN]
    return min(clean, key=_others, default=None)


def _without(sensor: int, begin: Snapshot, samples: Sequence[Sample]) -> Faulty | None:
    """Filter the samples without a sensor; its innovations are still charted."""
    filter, monitor = begin.filter.copy(), begin.monitor.copy()
    monitor.charts.begin_again()
    limits = np.full(monitor.sensors, np.inf)
    limits[sensor] = 0.0
    try:
        for sample in samples:
            monitor.add(filter.step(sample.time, sample.span, sample.values, limits))
    except FilterLostError:
        return None
    return Faulty(sensor, filter, monitor)


def _others(found: Faulty) -> float:
    """Return the highest chart of the other sensors, in thresholds."""
    rest = np.delete(found.monitor.heights, found.sensor)
    return float(max(rest.max(initial=0.0), found.monitor.height_of_squares))
