"""A program that steps states by calls of its adapter."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.core.threads import in_threads
from dashred.physics.external.adapter import Adapter, Unread
from dashred.physics.external.conduct import Conduct
from dashred.physics.external.examination import examine
from dashred.physics.external.kept.kept_results import WORTH_KEEPING, KeptResults
from dashred.physics.external.kept.recent_results import RecentResults
from dashred.physics.external.protocol import Stepper
from dashred.physics.external.rounding import equal
from dashred.physics.external.state_batch import Array, ProgramError, StateBatch
from dashred.physics.grids.grid import Grid
from dashred.physics.grids.mesh import Mesh

# Rounding error that is assumed until the first step: that of single precision.
SINGLE = 6e-8
# An analysis ends if more than this share of the states cannot be stepped, and so many.
MOST_FAILED, SOME_FAILED = 0.9, 10


class SteppedProgram:
    """A program behind an adapter, which the first step examines.

    Attributes:
        tangent: see :class:`dashred.physics.external.protocol.Program`.
    """

    def __init__(self, adapter: Adapter, grid: Grid | Mesh, keep: bool = True) -> None:
        """Set the program.

        Args:
            adapter: of the program.
            grid: of the system, whose states have the mirror image of an axis with equal ends; the
                program's states have not.
            keep: whether results of expensive calls are kept on disk.
        """
        self._adapter, self._grid, self._keep = adapter, grid, keep
        self._conduct: Conduct | None = None
        self._calls, self._recent = 0, RecentResults()
        self.tangent: Stepper | None = None
        self.forget_failures()

    @property
    def failure(self) -> str | None:
        """See :class:`dashred.physics.external.protocol.Program`."""
        if self._last_failure is None or not self._failed_steps:
            return None
        count = f"{self._failed_steps} of {self._steps} steps failed"
        return f"{count}, the last one: {self._last_failure}"

    def forget_failures(self) -> None:
        """See :meth:`dashred.physics.external.protocol.Program.forget_failures`."""
        self._last_failure: str | None = None
        # Steps of single states, including those whose results were kept.
        self._steps = self._failed_steps = 0
        # Of those that the program was called for, and of these the ones without a result.
        self._asked = self._lost = 0

    @property
    def conduct(self) -> Conduct:
        """How it is called; known after the first step."""
        assert self._conduct is not None, "a program is examined by its first step"
        return self._conduct

    @cached_property
    def sha256(self) -> str:
        """See :class:`dashred.physics.external.protocol.Program`."""
        return self._adapter.sha256()

    @property
    def rounding(self) -> float:
        """See :class:`dashred.physics.external.protocol.Program`."""
        return SINGLE if self._conduct is None else self._conduct.rounding

    @property
    def seconds(self) -> float:
        """See :class:`dashred.physics.external.protocol.Program`."""
        return 0.0 if self._conduct is None else self._conduct.seconds

    def seconds_of(self, count: int) -> float:
        """See :meth:`dashred.physics.external.protocol.Program.seconds_of`."""
        if self.conduct.many:
            return self.seconds
        return self.seconds * -(-count // self._adapter.at_once)

    def step(
        self,
        states: Array,
        t: Array,
        dt: Array,
        inputs: Mapping[str, Array],
        parameters: Mapping[str, float],
    ) -> Array:
        """See :meth:`dashred.physics.external.protocol.Program.step`."""
        # A copy before, because torch takes no array that cannot be written to.
        found = self._grid.own(torch.from_numpy(states.copy())).numpy().copy()
        # A program may fail for a step of no length, such as those that fill up a short segment.
        moving = np.flatnonzero(dt)
        if moving.size:
            batch = StateBatch(found, t, dt, inputs, parameters)
            found[moving] = self._step(batch.take(moving))
        return self._grid.ring(torch.from_numpy(found)).numpy()

    def _step(self, batch: StateBatch) -> Array:
        if self._conduct is None:
            self._open(batch)
        result = self._step_or_find(batch)
        # A trajectory that is lost stays so, which is no failure.
        asked = _finite_rows(batch.states)
        self._steps += int(asked.sum())
        self._failed_steps += int((asked & ~_finite_rows(result)).sum())
        return result

    def _step_or_find(self, batch: StateBatch) -> Array:
        """Return the states after a step, from earlier results where they are known."""
        results = self._results if self._keeps_results else self._recent
        keys = results.keys(batch)
        known = results.find(keys)
        result, missing = np.empty_like(batch.states), []
        for row, earlier in enumerate(known):
            if earlier is None or earlier.size != result[row].size:
                missing.append(row)
            else:
                result[row] = earlier.reshape(result[row].shape)
        if missing:
            result[missing] = found = self._step_all(batch.take(missing))
            results.keep([keys[row] for row in missing], found)
        return result

    def _open(self, batch: StateBatch) -> None:
        """Find how the program is called: from an earlier process, or by calling it."""
        kept = self._results.conduct() if self._keep else None
        if kept is None:
            try:
                kept = examine(self._adapter, batch.take([0]))
            except ProgramError as error:
                what = f"{self._adapter.name} {error}"
                raise InputError(what, where=self._adapter.place, hint=error.hint) from error
            if self._keep and kept.seconds >= WORTH_KEEPING:
                self._results.keep_conduct(kept)
        self._conduct = kept

    @property
    def _keeps_results(self) -> bool:
        return self._keep and self.conduct.seconds >= WORTH_KEEPING

    @cached_property
    def _results(self) -> KeptResults:
        words = json.dumps([self.sha256, *self._adapter.fields, *self._grid.files])
        return KeptResults(words)

    def _step_all(self, batch: StateBatch) -> Array:
        result = self._step_groups(batch, self.conduct)
        if self.conduct.many and not self._is_same_alone(batch, result):
            # What batches have returned until now may be wrong as well.
            self._conduct, self._recent = self.conduct.one_by_one(), RecentResults()
            return self._step_groups(batch, self._conduct)
        return result

    def _step_groups(self, batch: StateBatch, conduct: Conduct) -> Array:
        parts = min(self._adapter.at_once, len(batch))
        groups = [
            part
            for group in conduct.groups(batch)
            for part in np.array_split(group, parts)
            if part.size
        ]
        if len(groups) == 1:
            return self._stepped(batch, conduct)
        result = np.empty_like(batch.states)

        def run(j: int) -> None:
            result[groups[j]] = self._stepped(batch.take(groups[j]), conduct)

        for _ in in_threads(run, len(groups), self._adapter.at_once):
            pass
        return result

    def _is_same_alone(self, batch: StateBatch, result: Array) -> bool:
        """Whether the smallest state of a batch is stepped as it is without the others.

        A function may mix states in some batches only, for example if its number of substeps
        follows from the largest value. Calls 1, 2, 4, 8, ... are checked, which costs little.
        """
        self._calls += 1
        if self._calls & (self._calls - 1) or len(batch) == 1:
            return True
        row = int(np.argmin(np.abs(batch.states).reshape(len(batch), -1).max(axis=1)))
        alone = self._stepped(batch.take([row]), self.conduct.one_by_one())
        found = result[[row]]
        if not np.isfinite(alone).all():
            return not np.isfinite(found).all()
        return equal(found, alone, self.rounding)

    def _stepped(self, batch: StateBatch, conduct: Conduct) -> Array:
        """Return the states after a step; NaN for a state that cannot be stepped."""
        time = None if conduct.reads_time else Unread()
        try:
            result = self._adapter.call(batch, conduct.way, time)
        except ProgramError as error:
            if len(batch) > 1 or not conduct.reads_time:
                alone = conduct.one_by_one()
                rows = [self._stepped(batch.take([i]), alone) for i in range(len(batch))]
                return np.concatenate(rows)
            if _finite_rows(batch.states).any():
                self._last_failure = f"{self._adapter.name} {error}"
                self._lose(error)
            return np.full_like(batch.states, np.nan)
        self._asked += len(batch)
        finite = _finite_rows(result)
        failed = np.flatnonzero(_finite_rows(batch.states) & ~finite)
        if failed.size:
            when = f"at t = {batch.t[failed[0]]:g}"
            self._last_failure = f"{self._adapter.name} returns values that are not finite, {when}"
        result[~finite] = np.nan
        return result

    def _lose(self, error: ProgramError) -> None:
        """Count a state that cannot be stepped.

        Raises:
            InputError: so it is with nearly all states: an analysis would wait for nothing.
        """
        self._asked, self._lost = self._asked + 1, self._lost + 1
        if self._lost >= SOME_FAILED and self._lost > MOST_FAILED * self._asked:
            count = f"{self._lost} of {self._asked} steps"
            what = f"{self._adapter.name} fails in {count}; in the last one it {error}"
            raise InputError(what, where=self._adapter.place, hint=error.hint)


def _finite_rows(states: Array) -> NDArray[np.bool_]:
    """Return which states ``(batch, field, *grid)`` are finite, ``(batch,)``."""
    return np.asarray(np.isfinite(states).reshape(len(states), -1).all(axis=1))
