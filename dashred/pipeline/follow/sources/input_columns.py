"""Take the measured inputs of the simulator out of the messages of a stream."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Iterable

from dashred.inference.observer.live_inputs import LiveInputs
from dashred.pipeline.follow.remarks import Remarks
from dashred.pipeline.follow.sources.messages import Message

# An input without a sample for so many of its steps is held.
PATIENCE = 1.5
# Number of times of an input that are remembered, more than there are in a block of samples.
REMEMBERED = 10_000


class InputColumns:
    """Gives the readings of inputs to the simulator, and the others to the estimators.

    Attributes:
        inputs: that drive the simulator.

    Args:
        inputs: with the samples of the recording.
        step: time between two samples of an input.
        remarks: told of faults of the stream.
    """

    def __init__(self, inputs: LiveInputs, step: float, remarks: Remarks) -> None:
        self.inputs, self._step, self._remarks = inputs, step, remarks
        self._seen: dict[str, deque[float]] = {
            name: deque(maxlen=REMEMBERED) for name in inputs.columns
        }
        self._is_first = True

    def take(self, messages: Iterable[Message]) -> list[Message]:
        """Take the inputs out of messages, and return what is left of them."""
        left = []
        for message in messages:
            if self._is_first:
                self.inputs.forget_from(message.time)
                self._is_first = False
            known = {
                name: value
                for name, value in message.readings.items()
                if name in self._seen and not math.isnan(value)
            }
            if known and self._is_in_order(message.time):
                self.inputs.add(message.time, known)
                for name in known:
                    self._seen[name].append(message.time)
            rest = {n: value for n, value in message.readings.items() if n not in self._seen}
            if rest:
                left.append(Message(message.time, rest))
        return left

    def held(self, time: float) -> list[str]:
        """Return the inputs whose value at a time is that of an old sample."""
        found = []
        for name, times in self._seen.items():
            before = bisect_right(times, time)
            if not before or time - times[before - 1] > PATIENCE * self._step:
                found.append(name)
                what = f"no sample of the input {name!r} at {time:g}; its last value is held"
                self._remarks.once(f"input {name}", what)
        return found

    def _is_in_order(self, time: float) -> bool:
        if time >= self.inputs.last:
            return True
        what = f"the inputs of the time {time:g} come after those of {self.inputs.last:g}"
        self._remarks.once("late", f"{what}; they are left out")
        return False
