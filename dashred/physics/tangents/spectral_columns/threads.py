"""Integrate the columns of a sensitivity in threads, beside the trajectory that they follow."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dashred.core.threads import in_threads, thread_count
from dashred.physics.solvers.schedule import Step
from dashred.physics.tangents.spectral_columns.arrays import BlockArrays, Work
from dashred.physics.tangents.spectral_columns.equations import ColumnEquations, StageData
from dashred.physics.tangents.spectral_columns.groups import Groups

Array = NDArray[Any]

GROUP_POINTS = 2**13
"""Pairs of columns times values of a state that are integrated together, to fit in the cache."""
SHARED_POINTS = 2**18
"""Columns times values of a state from which several threads are faster than one."""
# Parts of the columns for each thread, if there are several. They are small, because one thread
# begins with the trajectory.
PARTS = 4


def columns_together(count: int, values: int) -> int:
    """Return how many columns are integrated together, an even number.

    Args:
        count: number of columns.
        values: number of values of a state.
    """
    pairs = max(1, math.ceil(count / 2))
    groups = math.ceil(pairs / max(1, GROUP_POINTS // values))
    return 2 * math.ceil(pairs / groups)


class Block(NamedTuple):
    """Some time steps.

    Attributes:
        steps: the steps.
        states: of the trajectory at output times.
        data: what the columns need of the trajectory.
    """

    steps: Sequence[Step]
    states: list[Array]
    data: StageData


class ThreadedColumns:
    """The columns, in parts for the threads.

    Attributes:
        parts: groups that are integrated in one task.
        threads: number of threads.

    Args:
        equations: of the columns.
        points: their values at the first time, ``(field, column, *grid)``.
        first: index of the first of them.
        pairs: number of pairs in a group.
    """

    def __init__(self, equations: ColumnEquations, points: Array, first: int, pairs: int) -> None:
        self.equations, self._points, self._first, self._pairs = equations, points, first, pairs
        groups = math.ceil(points.shape[1] / (2 * pairs))
        self.threads = thread_count() if points.size >= SHARED_POINTS else 1
        count = min(PARTS * self.threads if self.threads > 1 else 1, groups)
        edges = [round(i * groups / max(count, 1)) for i in range(count + 1)]
        self.parts = [range(begin, end) for begin, end in pairwise(edges)]
        self._groups: Groups | None = None
        self._work: list[Work] = []

    def advance(self, block: Block, blocks: Iterator[Block]) -> tuple[Block | None, Array]:
        """Integrate over a block of steps.

        Args:
            block: the steps.
            blocks: the later blocks; the next one is evaluated at the same time.

        Returns:
            The next block, or None at the end; and the columns at the output times of this one,
            ``(output, column, field, point)``.
        """
        result = self._begin(block)
        steps = self.equations.block(block.steps, block.data)
        following: list[Block | None] = []

        def run(task: int) -> None:
            if task == 0:
                following.append(next(blocks, None))
            else:
                self._advance_part(self.parts[task - 1], steps, result)

        for _ in in_threads(run, 1 + len(self.parts), self.threads):
            pass
        return following[0], result

    def _begin(self, block: Block) -> Array:
        """Prepare for a block, and return the array for its columns at output times."""
        fields, columns, *grid = self._points.shape
        if self._groups is None and self.parts:
            span = block.steps[-1].last - block.steps[0].first
            at = self._first, self._pairs, block.data, span
            with np.errstate(all="ignore"):
                self._groups = Groups.begin(self.equations, self._points, *at)
            self._work = [self._groups.work() for _ in range(self.threads)]
        shape = len(block.states), columns, fields, math.prod(grid)
        return np.empty(shape, dtype=self._points.dtype)

    def _advance_part(self, part: range, steps: BlockArrays, result: Array) -> None:
        """Integrate some groups, and write their columns at output times to the result."""
        assert self._groups is not None
        # There are as many as threads, so one is always left.
        work = self._work.pop()
        self._groups.advance(part, steps, work, result)
        self._work.append(work)
