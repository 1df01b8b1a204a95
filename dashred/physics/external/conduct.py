"""How a program is called, and what a call costs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dashred.physics.external.adapter import Way
from dashred.physics.external.state_batch import StateBatch


@dataclass(frozen=True)
class Conduct:
    """How a program is called, and what a call costs.

    Attributes:
        way: the way to call it.
        alone: the way to call it with one state.
        many: whether a call may have several states.
        reads_time: whether its result may depend on t.
        rounding: relative rounding error of its results.
        seconds: duration of a call with one state.
    """

    way: Way
    alone: Way
    many: bool
    reads_time: bool
    rounding: float
    seconds: float

    def groups(self, batch: StateBatch) -> Iterator[NDArray[np.int64]]:
        """Yield the rows of a batch that go in one call."""
        rows = np.arange(len(batch))
        if not self.many:
            yield from rows[:, None]
            return
        if self.way.arrays:
            yield rows
            return
        clocks = [batch.t, batch.dt] if self.reads_time else [batch.dt]
        values = np.stack([*clocks, *batch.inputs.values()], axis=1)
        _, group = np.unique(values, axis=0, return_inverse=True)
        for index in range(group.max() + 1):
            yield np.flatnonzero(group == index)

    def one_by_one(self) -> Conduct:
        """Return the same with one state in a call."""
        return replace(self, way=self.alone, many=False, reads_time=True)
