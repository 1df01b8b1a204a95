"""Put the messages of a stream on the clock of the run."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError, nearest
from dashred.pipeline.follow.remarks import Remarks
from dashred.pipeline.follow.sources.messages import Message

Array = NDArray[np.float64]

# A time is on the clock if it is off by less than this share of the step. Then the step is exact.
ON_CLOCK = 0.02
# After a longer gap, in steps, the filter begins again; the samples in a shorter one are missing.
LONGEST_GAP = 1000
# So many messages may come without any reading of a sensor of the run.
FOREIGN = 20
# A sensor that was missing in so many samples is not waited for.
PATIENCE = 10


class Sample(NamedTuple):
    """The readings of one time.

    Attributes:
        time: of the sample.
        span: time since the sample before.
        values: readings, ``(sensor,)``; NaN where missing.
        begins: whether the stream begins, or goes on after a long gap.
    """

    time: float
    span: float
    values: Array
    begins: bool


class Alignment:
    """Turns messages into samples.

    Messages of one time are one sample. It is complete when the sensors that usually report have
    done so, or when a later message comes. Missing samples are filled with samples without
    readings. Messages that are late, or between two samples of the clock, are left out.

    Args:
        sensors: names of the sensors of the run.
        step: of the clock.
        remarks: told of faults of the stream.
    """

    def __init__(self, sensors: Sequence[str], step: float, remarks: Remarks) -> None:
        self._columns = {name: index for index, name in enumerate(sensors)}
        self._step, self._remarks = step, remarks
        self._last: float | None = None
        self._pending: tuple[float, dict[int, float]] | None = None
        self._missed = np.full(len(sensors), PATIENCE)
        self._unknown: dict[str, None] = {}
        self._foreign = 0

    def add(self, messages: Iterable[Message]) -> list[Sample]:
        """Return the samples that the messages complete.

        Raises:
            InputError: no message has a reading of a sensor of the run.
        """
        return [sample for message in messages for sample in self._add(message)]

    def finish(self) -> list[Sample]:
        """Return the sample that waits for further readings."""
        return self._emit()

    def _add(self, message: Message) -> list[Sample]:
        readings = {
            self._columns[name]: value
            for name, value in message.readings.items()
            if name in self._columns
        }
        if len(readings) < len(message.readings):
            self._tell_unknown(message)
        if not readings:
            self._check_foreign(message)
            return []
        self._foreign = -1
        samples: list[Sample] = []
        if self._pending is not None:
            time, known = self._pending
            if abs(message.time - time) <= ON_CLOCK * self._step:
                if known.keys() & readings.keys():
                    self._remarks.once("doubled", f"two messages for the time {time:g}")
                self._pending = time, {**readings, **known}
                return self._emit() if self._is_complete() else []
            if message.time > time:
                samples = self._emit()
        if self._is_useful(message.time, readings):
            self._pending = message.time, readings
            if self._is_complete():
                samples += self._emit()
        return samples

    def _is_useful(self, time: float, readings: dict[int, float]) -> bool:
        last = self._pending[0] if self._pending is not None else self._last
        if last is None:
            return True
        steps = (time - last) / self._step
        if abs(steps) <= ON_CLOCK:
            # Readings of a sample that was thought complete: they are waited for from now on.
            self._missed[[*readings]] = 0
            self._remarks.once("doubled", f"two messages for the time {time:g}")
        elif steps < 0:
            text = f"the message of the time {time:g} comes after that of {last:g}; it is left out"
            self._remarks.once("late", text)
        elif steps < 0.5:
            text = f"samples are closer than the step {self._step:g} of the run; some are left out"
            self._remarks.once("close", text)
        return steps >= 0.5

    def _is_complete(self) -> bool:
        assert self._pending is not None
        expected = np.flatnonzero(self._missed < PATIENCE)
        return all(index in self._pending[1] for index in expected.tolist())

    def _emit(self) -> list[Sample]:
        if self._pending is None:
            return []
        (time, readings), self._pending = self._pending, None
        values = np.full(len(self._columns), math.nan)
        values[[*readings]] = [*readings.values()]
        # A reading that is NaN was reported: the sensor is there.
        self._missed += 1
        self._missed[[*readings]] = 0
        last, self._last = self._last, time
        if last is None:
            return [Sample(time, self._step, values, begins=True)]
        steps = (time - last) / self._step
        count = round(steps)
        if count > LONGEST_GAP:
            text = f"nothing came from {last:g} to {time:g}; the filter begins again"
            self._remarks.once("gap", text)
            return [Sample(time, self._step, values, begins=True)]
        if abs(steps - count) > ON_CLOCK:
            text = f"the time {time:g} is not on the clock of the run, whose step is {self._step:g}"
            self._remarks.once("clock", f"{text}; such samples are used at their own times")
            filled = last + self._step * np.arange(1, count)
            span = time - (filled[-1] if count > 1 else last)
        else:
            filled = time - self._step * np.arange(count - 1, 0, -1)
            span = self._step
        if count > 1:
            self._remarks.once("missing", f"samples are missing after the time {last:g}")
        empty = np.full(len(values), math.nan)
        gap = [Sample(float(each), self._step, empty, begins=False) for each in filled]
        return [*gap, Sample(time, float(span), values, begins=False)]

    def _tell_unknown(self, message: Message) -> None:
        new = [n for n in message.readings if n not in self._columns and n not in self._unknown]
        self._unknown |= dict.fromkeys(new)
        if new:
            what = f"the run has no sensor {', '.join(map(repr, new))}; it is left out"
            self._remarks.once(f"column {new[0]}", what)

    def _check_foreign(self, message: Message) -> None:
        if self._foreign < 0:
            return
        self._foreign += 1
        if self._foreign < FOREIGN and len(message.readings) < 2:
            return
        found = [*self._unknown]
        raise InputError(
            f"none of the sensors of the run is in the stream, which has {', '.join(found)}",
            where="source",
            hint=nearest(found[0] if found else "", self._columns),
        )
