"""Follow a stream from its first message to its end."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dashred.core.errors import InputError
from dashred.data.sensors import Sensor
from dashred.inference.observer.live_inputs import LiveInputs
from dashred.inference.observer.march import March
from dashred.inference.streaming.calibration import Calibration, calibrate
from dashred.inference.streaming.live_estimator import LiveEstimator, LiveSettings
from dashred.inference.streaming.live_filter import LiveFilter
from dashred.inference.streaming.live_observer import LiveObserver
from dashred.inference.streaming.monitor import Monitor
from dashred.inference.streaming.tracker import Alarm, Tracker
from dashred.pipeline.follow.alarm_window import AlarmWindow
from dashred.pipeline.follow.alignment import Alignment, Sample
from dashred.pipeline.follow.fields import FieldFile
from dashred.pipeline.follow.finished_run import FinishedRun, without_sensors
from dashred.pipeline.follow.follower import TEXTS, Follower
from dashred.pipeline.follow.places import parse_places, unmeasured_fields
from dashred.pipeline.follow.remarks import Remarks
from dashred.pipeline.follow.rows import Rows
from dashred.pipeline.follow.sources.input_columns import InputColumns
from dashred.pipeline.follow.sources.open_source import open_source
from dashred.pipeline.follow.words import alarm_text, calibration_text

# Samples that are worked on at once, and seconds until a source that is silent is asked again.
BLOCK, PATIENCE = 64, 0.2
# Fewest samples before the charts begin.
SETTLING = 20


@dataclass(frozen=True, kw_only=True)
class Settings:
    """The arguments of ``dashred follow``; see :mod:`.command`."""

    source: str
    output: Path | None
    at: Sequence[str]
    ahead: int
    rate: float
    members: int | None
    fields: Path | None
    every: int
    window: Path
    idle: float | None
    seed: int


def follow(run: FinishedRun, settings: Settings) -> None:
    """Follow a stream until it ends or is ended.

    Raises:
        InputError: the source cannot be opened, it is no stream of this system, or the corrected
            simulator cannot follow its own recording.
        OSError: a file cannot be written; all rows before are complete.
    """
    remarks = Remarks()
    run = without_sensors(run, run.faulty)
    places = (
        *unmeasured_fields(run.system, run.sensors),
        *parse_places(settings.at, run.system, run.sensors),
    )
    inputs = _inputs(run, remarks)
    calibration = _calibrated(run, inputs, places, settings)
    for line in calibration_text(calibration, run.names):
        remarks.say(line)
    if run.faulty:
        remarks.say(f"left out, because the run found them faulty: {', '.join(run.faulty)}")
    monitor = Monitor(calibration.innovations, calibration.serial, settings.rate)
    tracker = Tracker(calibration.filter, monitor, max(run.lags, SETTLING))
    with ExitStack() as stack:
        source = open_source(settings.source, remarks)
        stack.callback(source.close)
        follower = Follower(run, tracker, inputs, settings.ahead, remarks)
        rows = stack.enter_context(Rows(settings.output, [*follower.columns, *TEXTS]))
        session = _Session(run, settings, follower, inputs, rows, remarks)
        alignment = Alignment(run.names, run.step, remarks)
        with _ended_by_signals() as is_ended:
            heard = time.monotonic()
            while not (source.ended or is_ended()):
                messages = source.read(PATIENCE)
                readings = messages if inputs is None else inputs.take(messages)
                session.add(alignment.add(readings), is_ended)
                if messages:
                    heard = time.monotonic()
                elif settings.idle is not None and time.monotonic() >= heard + settings.idle:
                    break
            session.add(alignment.finish(), is_ended)
            session.finish()


def _inputs(run: FinishedRun, remarks: Remarks) -> InputColumns | None:
    """Return the inputs of the simulator; None without any."""
    if not run.system.inputs:
        return None
    step = max(run.step, float(np.median(np.diff(run.signals.times))))
    return InputColumns(LiveInputs(run.system, run.signals), step, remarks)


def _calibrated(
    run: FinishedRun, inputs: InputColumns | None, places: Sequence[Sensor], settings: Settings
) -> Calibration:
    march = March(run.system) if inputs is None else March(inputs.inputs.system, inputs.inputs)
    try:
        return calibrate(_estimator(run, march, places, settings), run.times, run.values)
    except InputError as error:
        raise InputError(error.what, where=str(run.folder), hint=error.hint) from None


def _estimator(
    run: FinishedRun, march: March, places: Sequence[Sensor], settings: Settings
) -> LiveEstimator:
    """Return an observer; or an ensemble filter, if it is asked for."""
    known = march, run.sensors, places, run.noise, run.climate
    if settings.members is None:
        return LiveObserver(*known, run.step, LiveSettings(), settings.seed)
    return LiveFilter(*known, settings.members, LiveSettings(), settings.seed)


class _Session:
    """Writes the rows, fields and windows of a stream."""

    def __init__(
        self,
        run: FinishedRun,
        settings: Settings,
        follower: Follower,
        inputs: InputColumns | None,
        rows: Rows,
        remarks: Remarks,
    ) -> None:
        self._run, self._settings, self._follower = run, settings, follower
        self._inputs = None if inputs is None else inputs.inputs
        self._rows, self._remarks = rows, remarks
        self._fields = None if settings.fields is None else FieldFile(settings.fields, run.system)
        self._window: AlarmWindow | None = None
        self._count = self._alarms = 0

    def add(self, samples: Sequence[Sample], is_ended: Callable[[], bool]) -> None:
        """Follow samples in blocks; after an end is asked for, the rest is left."""
        samples = [self._without_faulty(sample) for sample in samples]
        while samples and not is_ended():
            size = BLOCK
            if self._fields is not None:
                size = min(size, self._settings.every - self._count % self._settings.every)
            block, samples = samples[:size], samples[size:]
            self._count += len(block)
            self._add(block)

    def _add(self, block: Sequence[Sample]) -> None:
        rows = self._follower.add(block)
        self._rows.write([(row.numbers.tolist(), row.texts) for row in rows])
        begun = self._window
        for row in rows:
            if row.alarm is not None:
                self._tell(row.alarm)
        if begun is not None and begun is self._window:
            begun.add([(sample.time, sample.values) for sample in block])
        if self._fields is not None and self._count % self._settings.every == 0:
            fields = self._follower.fields
            assert fields is not None
            self._fields.add(*fields)

    def _tell(self, alarm: Alarm) -> None:
        """Say what an alarm means, and begin or end its window."""
        self._remarks.say(alarm_text(alarm, self._run.names, self._follower.is_at_begin))
        if alarm.kind == "ended":
            if self._window is not None:
                self._window.close()
            self._window = None
            return
        if self._window is not None:
            return
        self._alarms += 1
        recent = [(t, values) for t, values in self._follower.recent if t >= alarm.since]
        seen = ~np.isnan(np.array([values for _, values in recent])).all(axis=0)
        columns = np.flatnonzero(seen).tolist()
        sensors = [self._run.sensors[index] for index in columns]
        self._window = AlarmWindow(
            self._settings.window, self._run.system, sensors, columns, self._inputs
        )
        self._window.add(recent)
        self._remarks.say(
            f"the samples since then are in {self._window.path}, which goes on while the alarm "
            f"lasts. To analyse it:\n  {self._window.command(self._run.folder)}"
        )

    def finish(self) -> None:
        """Write what is waiting, and say what has happened."""
        if self._fields is not None:
            self._fields.flush()
        if self._window is not None:
            self._window.close()
        counted = [f"{kind} ({count})" for kind, count in self._remarks.counts.items()]
        faults = f"; remarks: {', '.join(counted)}" if counted else ""
        self._remarks.say(f"{self._count} samples, {self._alarms} alarms{faults}")

    def _without_faulty(self, sample: Sample) -> Sample:
        if not self._run.faulty:
            return sample
        columns = [index for index, name in enumerate(self._run.names) if name in self._run.faulty]
        values = sample.values.copy()
        values[columns] = np.nan
        return sample._replace(values=values)


@contextmanager
def _ended_by_signals() -> Iterator[Callable[[], bool]]:
    """Yield a function that returns whether Ctrl-C, or a request to terminate, has come.

    The rows are then written to the last one. A second Ctrl-C ends at once.
    """
    asked: list[int] = []

    def ask(number: int, frame: object) -> None:
        if asked:
            raise KeyboardInterrupt
        asked.append(number)

    before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: bool(asked)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
