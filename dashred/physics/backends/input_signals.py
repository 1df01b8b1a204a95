"""Inputs of a system as they were measured: straight lines between samples, held at both ends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class InputSignals:
    """``u(t)`` of every input.

    Attributes:
        times: of the samples, on the recording's clock, increasing, ``(sample,)``.
        values: by the input's name in the equations, ``(sample,)``.
    """

    times: Array
    values: Mapping[str, Array]

    def at(self, t: float | Array) -> dict[str, Array]:
        """Return every input at some times, in the shape of ``t``."""
        found = {name: np.interp(t, self.times, values) for name, values in self.values.items()}
        return {name: np.asarray(values) for name, values in found.items()}

    @cached_property
    def table(self) -> Array:
        """Times and values one below the other, ``(1 + input, sample)``."""
        return np.ascontiguousarray([self.times, *self.values.values()])


NO_INPUTS = InputSignals(np.zeros(1), {})
