"""Follow a stream: filter every sample, watch the innovations, and say what an alarm means."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dashred.inference.streaming.diagnosis import LONGEST, Sample, Snapshot, without_one_sensor
from dashred.inference.streaming.live_estimator import Analysed, LiveEstimator
from dashred.inference.streaming.monitor import Monitor

Array = NDArray[np.float64]
# An alarm begins; then what has changed: one sensor, several at once, or the only sensor; its end.
Kind = Literal["begun", "sensor", "several", "only", "ended"]

# A lone innovation above this many standard deviations is an outlier, and is not assimilated.
OUTLIER, LONGEST_OUTLIER = 6.0, 2
# Number of samples between copies of the state.
EVERY = 32
# A sensor is part of an alarm of others if its chart is above this share of the threshold.
INVOLVED = 0.5
# After so many more samples, it is clear whether the other sensors have changed, too.
DELIBERATION = 20
# An alarm of several sensors ends after so many samples without another one.
QUIET = 100


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

    Some samples after an alarm the filter is run again from a state before it, without each
    suspected sensor in turn. If the others are white noise without one sensor, this sensor alone
    has changed. It is left out until its readings agree with the filter again. Otherwise the filter
    draws new members from the climate: a filter that trusts a wrong state, or a law that no longer
    holds, would hardly listen to the sensors.

    Attributes:
        filter: with the state after the last sample.
        monitor: its charts.
        left_out: which sensors are left out, ``(sensor,)``.
        is_settled: whether enough samples have passed for the charts to begin.
    """

    def __init__(self, filter: LiveEstimator, monitor: Monitor, settling: int) -> None:
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
        self._since = math.nan
        self._count, self._settled_at, self._decides_at, self._ends_at = 0, settling, 0, 0

    @property
    def is_settled(self) -> bool:
        """Whether the charts have begun."""
        return self._count > self._settled_at

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
        if self.is_settled and (self._count % EVERY == 0 or not self._snapshots):
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
        """Draw new members, and wait until the filter has settled again; no alarm remains."""
        self._settle()
        self._kind, self._alarmed = None, set()
        self.left_out[:] = False

    def _settle(self) -> None:
        self.filter.begin()
        self.monitor.charts.begin_again()
        self._settled_at = self._count + self._settling
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
        is_above = bool(above) or self.monitor.height_of_squares > 1
        if self._kind is None:
            return self._begin(time, above) if is_above else None
        if self._kind == "begun":
            self._alarmed |= above
            return self._decide(time, heights) if self._count >= self._decides_at else None
        others = above - self._alarmed
        if self._kind == "sensor" and (others or self.monitor.height_of_squares > 1):
            # Another sensor follows: it was not the first one alone.
            return self._several(time, heights)
        if self._kind != "sensor" and is_above:
            self._alarmed |= above
            self._settle_in_alarm()
            return None
        return self._end_if_over(time, heights)

    def _settle_in_alarm(self) -> None:
        self._settle()
        self._ends_at = self._settled_at + QUIET

    def _begin(self, time: float, above: set[int]) -> Alarm:
        self._kind, self._alarmed = "begun", above
        self._decides_at = self._count + DELIBERATION
        self._since = self._time_of_zero(above)
        values = np.array([sample.values for sample in self._history])
        active = np.flatnonzero(~np.isnan(values).all(axis=0))
        if len(active) < 2:
            self._kind, self._alarmed = "only", set(active.tolist())
            self._settle_in_alarm()
        return Alarm(self._kind, self.alarmed, time, self._since)

    def _decide(self, time: float, heights: Array) -> Alarm:
        """Say whether it is one sensor, by filtering the last samples without it."""
        first = self._history[-1].index - len(self._history)
        begun = next((s.index for s in self._history if s.time >= self._since), first)
        found = without_one_sensor(self._snapshots, self._history, heights, begun)
        if found is None:
            return self._several(time, heights)
        self.filter, self.monitor = found.filter, found.monitor
        self._kind, self._alarmed = "sensor", {found.sensor}
        self.left_out[found.sensor] = True
        return Alarm("sensor", self.alarmed, time, self._since)

    def _several(self, time: float, heights: Array) -> Alarm:
        self._alarmed |= set(np.flatnonzero(heights > INVOLVED).tolist())
        self._kind = "several"
        self.left_out[:] = False
        self._settle_in_alarm()
        return Alarm("several", self.alarmed, time, self._since)

    def _end_if_over(self, time: float, heights: Array) -> Alarm | None:
        if self._kind == "sensor":
            is_over = not heights[[*self.alarmed]].any()
        else:
            is_over = self._count >= self._ends_at
        if not is_over:
            return None
        ended = Alarm("ended", self.alarmed, time, time)
        self._kind, self._alarmed = None, set()
        self.left_out[:] = False
        return ended

    def _time_of_zero(self, sensors: set[int]) -> float:
        """Return the time of the first sample after the last zero of the charts."""
        charts = sorted(sensors) if sensors else [None]
        ago = max(self.monitor.samples_since_zero(chart) for chart in charts)
        times = [sample.time for sample in self._history]
        return times[max(0, len(times) - max(ago, 1))]
