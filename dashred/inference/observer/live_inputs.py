"""Measured inputs of a stream, which drive a simulator while they come in."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from dashred.data.inputs import acting_signals
from dashred.physics.backends.input_signals import InputSignals
from dashred.physics.system import System

Array = NDArray[np.float64]

# Knots of the curves that the simulator reads at once, and samples that are remembered: an alarm
# is examined with the inputs of the samples before it.
KNOTS, REMEMBERED = 1024, 25_000
# The end of a step may be this share of it too early.
ROUNDING = 1e-6


class LiveInputs:
    """The samples of the inputs, and a simulator that they drive.

    The simulator reads the present values of one table at each step, so that it is compiled once.
    Nothing is known of an input after its last sample, whose value is then held.

    Attributes:
        system: the simulator with the inputs.
        columns: of the recording with the inputs.

    Args:
        system: the simulator without inputs.
        recorded: samples of the recording by column.
    """

    def __init__(self, system: System, recorded: InputSignals) -> None:
        self._declared = system
        self.columns = tuple(dict.fromkeys(system.inputs.values()))
        # The first row has the times. The oldest half is forgotten where there is no room left.
        samples = np.array([recorded.times, *(recorded.values[name] for name in self.columns)])
        self._count = samples.shape[1]
        room = 2 * max(self._count, REMEMBERED)
        self._samples = np.zeros((len(samples), room))
        self._samples[:, : self._count] = samples
        self._table = np.zeros((1 + len(system.inputs), KNOTS))
        self._shown: tuple[int, int] | None = None
        self._delay = max(declared.delay for declared in system.config.inputs.values())
        signals = InputSignals.on_table([*system.inputs], self._table)
        self.system = system.with_input_signals(signals)
        self.show(self.first, self.first)

    @property
    def first(self) -> float:
        """Time of the first sample that is remembered."""
        return float(self._samples[0, 0])

    @property
    def last(self) -> float:
        """Time of the last sample."""
        return float(self._samples[0, self._count - 1])

    def add(self, time: float, readings: Mapping[str, float]) -> None:
        """Add a sample that is not earlier than the last one.

        Args:
            time: of the sample.
            readings: by column; the value before is held where one is missing.
        """
        if time > self.last:
            if self._count == self._samples.shape[1]:
                self._count //= 2
                self._samples[:, : self._count] = self._samples[:, self._count :]
            self._samples[:, self._count] = self._samples[:, self._count - 1]
            self._samples[0, self._count] = time
            self._count += 1
        for row, column in enumerate(self.columns, 1):
            if column in readings:
                self._samples[row, self._count - 1] = readings[column]
        self._shown = None

    def forget_from(self, time: float) -> None:
        """Forget the samples from a time on, because another record begins there.

        Args:
            time: of the first sample of the other record. If none is earlier, the first value is
                held until then.
        """
        times = self._samples[0, : self._count]
        self._count = max(1, int(np.searchsorted(times, time)))
        times[0] = min(times[0], np.nextafter(time, -np.inf))
        self._shown = None

    def at(self, time: float) -> Array:
        """Return what the columns read at a time, ``(column,)``."""
        times, *columns = self._samples[:, : self._count]
        return np.array([np.interp(time, times, values) for values in columns])

    def show(self, begin: float, known: float) -> None:
        """Let the simulator read the inputs from a time on, and hold what is known at another.

        Args:
            begin: earliest time of the next step.
            known: time of the last sample that may be used.
        """
        times = self._samples[0, : self._count]
        known += ROUNDING * (known - begin)
        first = max(0, int(np.searchsorted(times, begin - self._delay, "right")) - 1)
        last = max(first + 1, int(np.searchsorted(times, known, "right")))
        if (first, last) == self._shown:
            return
        self._shown = first, last
        times, values = times[first:last], self._samples[1:, first:last]
        if self._delay:
            # The last value acts until the end of the delay, and is held then.
            times = np.append(times, max(known, times[-1]) + 2 * self._delay)
            values = np.append(values, values[:, -1:], axis=1)
        samples = InputSignals(times, dict(zip(self.columns, values, strict=True)))
        curves = acting_signals(self._declared, samples)
        knots = np.array([curves.times, *curves.values.values()])[:, -KNOTS:]
        count = knots.shape[1]
        self._table[:, :count] = knots
        # Times have to increase; the last value is held.
        step = 1.0 + abs(float(knots[0, -1]))
        self._table[0, count:] = knots[0, -1] + step * np.arange(1, KNOTS - count + 1)
        self._table[1:, count:] = knots[1:, -1:]
