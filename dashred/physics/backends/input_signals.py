"""Measured inputs of a system, interpolated linearly between samples.

The first and the last value are held outside of the recording.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class InputSignals:
    """Measured input signals ``u(t)``.

    Attributes:
        times: sample times on the recording's clock, increasing, ``(sample,)``.
        values: samples by name of the input in the equations, ``(sample,)`` each.
        jumps: times at which an input jumps, increasing, ``(jump,)``. The sample at such a time is
            that after the jump.
    """

    times: Array
    values: Mapping[str, Array]
    jumps: Array = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def on_table(cls, names: Sequence[str], table: Array) -> InputSignals:
        """Return signals without jumps that read a table, whose values may change later.

        Args:
            names: of the inputs.
            table: as in :attr:`table`, contiguous. Simulators that are compiled with the signals
                read its present values.
        """
        found = cls(table[0], dict(zip(names, table[1:], strict=True)))
        vars(found)["table"] = table
        return found

    def at(self, t: float | Array) -> dict[str, Array]:
        """Return every input at times ``t``, with the shape of ``t``."""
        result = {name: np.interp(t, self.times, values) for name, values in self.values.items()}
        return {name: np.asarray(values) for name, values in result.items()}

    @cached_property
    def table(self) -> Array:
        """Times in the first row, then the values of each input, ``(1 + input, sample)``."""
        return np.ascontiguousarray([self.times, *self.values.values()])


NO_INPUTS = InputSignals(np.zeros(1), {})
