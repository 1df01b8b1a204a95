"""Follow a stream: filter every sample, watch the innovations, and say what an alarm means."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dashred.inference.streaming.diagnosis import LONGEST, Sample, Snapshot, without_one_sensor
from dashred.inference.streaming.live_filter import Analysed, LiveFilter
from dashred.inference.streaming.monitor import Monitor

Array = NDArray[np.float64]
# What may have changed: one sensor, several at once, the only sensor, or an end of the alarm.
Kind = Literal["sensor", "several", "only", "ended"]

# A lone innovation above this many standard deviations is an outlier, and is not assimilated.
OUTLIER, LONGEST_OUTLIER = 6.0, 2
# Number of samples between copies of the state.
EVERY = 32
# A sensor is part of an alarm of others if its chart is above this share of the threshold.
INVOLVED = 0.5


@dataclass(frozen=True)
class Alarm:
    """Something has changed.

    Attributes:
        kind: what has changed.
        sensors: indices of the sensors that tell it; empty if only all of them together do.
        time: of the alarm.
        since: time of the first sample after the last zero of the charts.
    """

    kind: Kind
    sensors: tuple[int, ...]
    time: float
    since: float


class Tracked(NamedTuple):
    """A sample of the stream after the filter.

    Attributes:
        analysed: result of the filter.
        white: whitened innovations, ``(sensor,)``.
        outliers: which readings were taken for outliers, ``(sensor,)``.
        alarm: an alarm that begins, changes or ends here.
    """

    analysed: Analysed
    white: Array
    outliers: NDArray[np.bool_]
    alarm: Alarm | None


class Tracker:
    """The filter with its charts and a short history.

    After an alarm the filter is run again from a state before it, without each suspected sensor in
    turn. If the others are white noise without one sensor, this sensor alone has changed. It is
    left out until its readings agree with the filter again.

    Attributes:
        filter: with the state after the last sample.
        monitor: its charts.
        left_out: which sensors are left out, ``(sensor,)``.
        is_settled: whether enough samples have passed for the charts to begin.
    """

    def __init__(self, filter: LiveFilter, monitor: Monitor, settling: int) -> None:
        """Begin with a filter.

        Args:
            filter: the filter.
            monitor: charts that have not begun.
            settling: number of samples before the charts begin.
        """
        self.filter, self.monitor, self._settling = filter, monitor, settling
        self.left_out = np.zeros(monitor.sensors, dtype=bool)
        self._outliers = np.zeros(monitor.sensors, dtype=np.int64)
        self._history: deque[Sample] = deque(maxlen=LONGEST)
        self._snapshots: deque[Snapshot] = deque(maxlen=LONGEST // EVERY)
        self._alarmed: set[int] = set()
        self._kind: Kind | None = None
        self._count = 0

    @property
    def is_settled(self) -> bool:
        """Whether the charts have begun."""
        return self._count > self._settling

    @property
    def alarmed(self) -> tuple[int, ...]:
        """Indices of the sensors with an alarm."""
        return tuple(sorted(self._alarmed))

    @property
    def kind(self) -> Kind | None:
        """What the present alarm says; None without an alarm."""
        return self._kind

    def add(self, time: float, span: float, values: Array) -> Tracked:
        """Add the next sample.

        Args:
            time: of the sample.
            span: time since the sample before.
            values: readings, ``(sensor,)``; NaN where missing.

        Raises:
            FilterLostError: most members have blown up; see :meth:`begin_again`.
        """
        if self.is_settled and self._count % EVERY == 0:
            copies = self.filter.copy(), self.monitor.copy()
            self._snapshots.append(Snapshot(self._count, *copies))
        limits = self._limits()
        analysed = self.filter.step(time, span, values, limits)
        white = self.monitor.add(analysed, self.is_settled)
        self._history.append(Sample(self._count, time, span, values))
        far = np.abs(analysed.innovation) >= OUTLIER * analysed.innovation_std
        outliers = far & np.isfinite(limits) & ~self.left_out
        self._outliers = np.where(outliers, self._outliers + 1, 0)
        self._count += 1
        alarm = self._alarm(time) if self.is_settled else None
        return Tracked(analysed, white, outliers, alarm)

    def begin_again(self) -> None:
        """Draw new members, and wait until the filter has settled again."""
        self.filter.begin()
        self.monitor.charts.begin_again()
        self._count = 0
        self._history.clear()
        self._snapshots.clear()

    def _limits(self) -> Array:
        limits = np.full(self.monitor.sensors, math.inf)
        if self.is_settled and self._kind is None:
            limits[self._outliers < LONGEST_OUTLIER] = OUTLIER
        limits[self.left_out] = 0.0
        return limits

    def _alarm(self, time: float) -> Alarm | None:
        heights = self.monitor.heights
        above = set(np.flatnonzero(heights > 1).tolist())
        squares = self.monitor.height_of_squares > 1
        if self._kind is None and (above or squares):
            return self._begin(time, above, heights)
        if self._kind == "sensor" and (above - self._alarmed or squares):
            # Another sensor follows: it was not the first one alone.
            return self._several(time, above, heights)
        self._alarmed |= above
        if self._kind is not None:
            return self._end_if_over(time, heights)
        return None

    def _begin(self, time: float, above: set[int], heights: Array) -> Alarm:
        values = np.array([sample.values for sample in self._history])
        active = np.flatnonzero(~np.isnan(values).all(axis=0))
        if len(active) < 2:
            self._kind, self._alarmed = "only", set(active.tolist())
            return Alarm("only", self.alarmed, time, self._since(above or None))
        found = without_one_sensor(
            self._snapshots, self._history, heights, self._index_since(above or None)
        )
        if found is None:
            return self._several(time, above, heights)
        since = self._since({found.sensor})
        self.filter, self.monitor = found.filter, found.monitor
        self._kind, self._alarmed = "sensor", {found.sensor}
        self.left_out[found.sensor] = True
        return Alarm("sensor", (found.sensor,), time, since)

    def _several(self, time: float, above: set[int], heights: Array) -> Alarm:
        involved = set(np.flatnonzero(heights > INVOLVED).tolist()) | above | self._alarmed
        since = self._since(involved or None)
        self._kind, self._alarmed = "several", involved
        self.left_out[:] = False
        return Alarm("several", self.alarmed, time, since)

    def _end_if_over(self, time: float, heights: Array) -> Alarm | None:
        if heights[self.alarmed,].any() or self.monitor.height_of_squares > INVOLVED:
            return None
        ended = Alarm("ended", self.alarmed, time, time)
        self._kind, self._alarmed = None, set()
        self.left_out[:] = False
        return ended

    def _index_since(self, sensors: set[int] | None) -> int:
        """Return the number of the first sample after the last zero of the charts."""
        each = [None] if sensors is None else sorted(sensors)
        ago = max(self.monitor.samples_since_zero(sensor) for sensor in each)
        return self._count - ago

    def _since(self, sensors: set[int] | None) -> float:
        first = self._index_since(sensors)
        return next(
            (sample.time for sample in self._history if sample.index >= first),
            self._history[-1].time,
        )
