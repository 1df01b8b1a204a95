"""Turn the samples of a stream into rows of estimates, with flags and alarms."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from dashred.inference.initial_state.ensemble_filter import FilterLostError
from dashred.inference.streaming.tracker import Alarm, Tracked, Tracker
from dashred.pipeline.follow.alignment import LONGEST_GAP, Sample
from dashred.pipeline.follow.finished_run import FinishedRun
from dashred.pipeline.follow.remarks import Remarks
from dashred.pipeline.follow.sources.input_columns import InputColumns
from dashred.pipeline.follow.surrogate_stream import SurrogateStream

Array = NDArray[np.float64]

# Flags of a row. A row without a flag is an estimate as good as in the recording of the run.
SETTLING, MISSING, LOST, OUTLIER, LEFT_OUT = "settling", "missing", "lost", "outlier", "left-out"
HELD = "held"
# Numbers of a row, of every quantity and of every sensor, and texts at its end.
OF_QUANTITIES = ("filter", "spread", "shred", "forecast")
OF_SENSORS = ("innovation", "standardised")
TEXTS = ("flag", "alarm")
# Number of samples that are kept for the window of an alarm.
KEPT = 4000
# An alarm in so many first samples means that the stream has never agreed with the filter.
BEGINNING = 50
# The filter goes on from the recording if all innovations of the first sample are below this many
# standard deviations.
AGREES = 5.0


class Row(NamedTuple):
    """One row of the output, with an alarm that begins, changes or ends there."""

    numbers: Array
    texts: tuple[str, str]
    alarm: Alarm | None


class Fields(NamedTuple):
    """Fields of the last sample, ``(field, *point)``, of both estimators."""

    time: float
    filtered: Array
    shred: Array


class _Part(NamedTuple):
    """A row without the estimate of SHRED, and the input of SHRED."""

    sample: Sample
    tracked: Tracked
    inputs: Array
    forecast: Array
    texts: tuple[str, str]


class Follower:
    """Estimates for every sample.

    Attributes:
        columns: names of the numbers of a row.
        recent: times and readings of the last samples.
        fields: of the last sample.
    """

    def __init__(
        self,
        run: FinishedRun,
        tracker: Tracker,
        inputs: InputColumns | None,
        ahead: int,
        remarks: Remarks,
    ) -> None:
        """Begin before the first sample.

        Args:
            run: the run.
            tracker: filter and charts, after the recording of the run.
            inputs: of the simulator; None without any.
            ahead: number of steps of the forecast.
            remarks: told of a filter that is lost.
        """
        self._run, self._tracker, self._inputs, self._remarks = run, tracker, inputs, remarks
        self._span = ahead * run.step
        self._surrogate = SurrogateStream(run.shred, run.lags)
        self._is_first = True
        self._agreed = 0
        self.recent: deque[tuple[float, Array]] = deque(maxlen=KEPT)
        self.fields: Fields | None = None
        names = [each.name for each in (*tracker.filter.sensors, *tracker.filter.places)]
        columns = {what: names for what in OF_QUANTITIES} | {what: run.names for what in OF_SENSORS}
        self.columns = ["time", *(f"{n}.{what}" for what, each in columns.items() for n in each)]

    @property
    def is_at_begin(self) -> bool:
        """Whether the stream has hardly agreed with the filter yet."""
        return self._agreed < BEGINNING

    def add(self, samples: Sequence[Sample]) -> list[Row]:
        """Return the rows of the next samples.

        The filter goes from sample to sample. SHRED then reads the windows of all of them at once.
        """
        rows: list[Row] = []
        parts: list[_Part] = []
        for sample in samples:
            if sample.begins:
                rows += self._rows(parts)
                parts = []
                self._begin(sample)
            found, is_lost = self._step(sample)
            forecast = self._tracker.filter.ahead(self._span)
            texts = self._flags(sample, found, is_lost)
            parts.append(_Part(sample, found, self._network_input(sample, found), forecast, texts))
            self.recent.append((sample.time, sample.values))
        return rows + self._rows(parts)

    def _begin(self, sample: Sample) -> None:
        """Go on from the end of the recording if the stream follows it; else begin anew."""
        self._surrogate.begin_again()
        if not (self._is_first and self._follows_recording(sample)):
            self._tracker.begin_again()
        self._is_first = False

    def _follows_recording(self, sample: Sample) -> bool:
        """Run the filter to the sample before the first one; return whether the first one fits."""
        filter, step = self._tracker.filter, self._run.step
        steps = round((sample.time - filter.time) / step)
        if not 0 < steps <= LONGEST_GAP:
            return False
        nothing, none = np.full(len(self._run.sensors), np.nan), np.zeros(len(self._run.sensors))
        try:
            for i in range(1, steps):
                filter.step(sample.time - (steps - i) * step, step, nothing, none)
            found = filter.copy().step(sample.time, sample.span, sample.values, none)
        except FilterLostError:
            return False
        far = np.abs(found.innovation) > AGREES * found.innovation_std
        return not far.any()

    def _step(self, sample: Sample) -> tuple[Tracked, bool]:
        try:
            return self._tracker.add(sample.time, sample.span, sample.values), False
        except FilterLostError:
            self._remarks.once("lost", f"the ensemble blows up at t = {sample.time:g}; begun again")
            self._tracker.begin_again()
            return self._tracker.add(sample.time, sample.span, sample.values), True

    def _network_input(self, sample: Sample, found: Tracked) -> Array:
        """Return the input of SHRED; where a reading is not used, it is that of the filter."""
        unused = np.isnan(sample.values) | found.outliers | self._tracker.left_out
        estimate = found.analysed.estimate[: len(sample.values)]
        return np.where(unused, estimate, sample.values)[[*self._run.network_sensors]]

    def _flags(self, sample: Sample, found: Tracked, is_lost: bool) -> tuple[str, str]:
        names, tracker = self._run.names, self._tracker
        flags = []
        if is_lost:
            flags.append(LOST)
        if not tracker.is_settled:
            flags.append(SETTLING)
        elif tracker.kind is None:
            self._agreed += 1
        if np.isnan(sample.values).all():
            flags.append(MISSING)
        if self._inputs is not None:
            flags += [f"{HELD}:{name}" for name in self._inputs.held(sample.time)]
        flags += [f"{OUTLIER}:{names[i]}" for i in np.flatnonzero(found.outliers)]
        flags += [f"{LEFT_OUT}:{names[i]}" for i in np.flatnonzero(tracker.left_out)]
        if tracker.kind is None:
            return " ".join(flags), ""
        return " ".join(flags), " ".join(names[i] for i in tracker.alarmed) or "all"

    def _rows(self, parts: Sequence[_Part]) -> list[Row]:
        """Return the rows of samples, with the estimates of SHRED."""
        if not parts:
            return []
        filter = self._tracker.filter
        fields = torch.from_numpy(self._surrogate.add(np.stack([part.inputs for part in parts])))
        own = self._run.system.grid.own(fields).numpy()
        self.fields = Fields(parts[-1].sample.time, filter.mean, own[-1])
        rows = []
        for part, state in zip(parts, own.reshape(len(own), 1, -1), strict=True):
            time, found = part.sample.time, part.tracked.analysed
            shred = filter.quantities(state, time)[0]
            of_quantities = (found.estimate, found.spread, shred, part.forecast)
            numbers = np.concatenate([[time], *of_quantities, found.innovation, part.tracked.white])
            rows.append(Row(numbers, part.texts, part.tracked.alarm))
        return rows
