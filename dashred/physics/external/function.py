"""A function in Python as a program that steps states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dashred.core.errors import InputError
from dashred.physics.external.calls import Function, Unread, call
from dashred.physics.external.conduct import Conduct, equal, examine
from dashred.physics.external.state_batch import Array, ProgramError, StateBatch, as_array


class FunctionProgram:
    """A function ``(state, t, dt, inputs, parameters)`` that returns the state at ``t + dt``.

    Attributes:
        failure: what it said when it last failed.
    """

    failure: str | None = None

    def __init__(self, function: Function, fields: Sequence[str], name: str, place: str) -> None:
        """Set the function and where it was named.

        Args:
            function: the user's function.
            fields: of the system.
            name: of the function, for messages.
            place: location of its key.
        """
        self._function, self._fields = function, fields
        self._name, self._place = name, place
        self._conduct: Conduct | None = None
        self._calls = 0

    @property
    def conduct(self) -> Conduct:
        """How it is called; known after the first step."""
        assert self._conduct is not None, "a program is examined by its first step"
        return self._conduct

    @property
    def rounding(self) -> float:
        """See :class:`dashred.physics.external.program.Program`."""
        return self.conduct.rounding

    @property
    def seconds(self) -> float:
        """See :class:`dashred.physics.external.program.Program`."""
        return self.conduct.seconds

    def step(
        self,
        states: Array,
        t: Array,
        dt: Array,
        inputs: Mapping[str, Array],
        parameters: Mapping[str, float],
    ) -> Array:
        """See :meth:`dashred.physics.external.program.Program.step`."""
        batch = StateBatch(states, t, dt, inputs, parameters)
        if self._conduct is None:
            try:
                self._conduct = examine(self._function, self._fields, batch.take([0]))
            except ProgramError as error:
                what = f"{self._name} {error}"
                raise InputError(what, where=self._place, hint=error.hint) from error
        result = np.empty_like(states)
        for rows in self._conduct.groups(batch):
            result[rows] = self._stepped(batch.take(rows), self._conduct)
        if self._conduct.many and not self._is_same_alone(batch, result):
            self._conduct = self._conduct.one_by_one()
            return self.step(states, t, dt, inputs, parameters)
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
            result = call(self._function, self._fields, batch, conduct.way, time)
        except ProgramError as error:
            if len(batch) > 1 or not conduct.reads_time:
                alone = conduct.one_by_one()
                rows = [self._stepped(batch.take([i]), alone) for i in range(len(batch))]
                return np.concatenate(rows)
            self.failure = f"{self._name} {error}"
            return np.full_like(batch.states, np.nan)
        finite = np.isfinite(result).reshape(len(batch), -1).all(axis=1)
        if not finite.all():
            when = batch.t[int(np.argmin(finite))]
            self.failure = f"{self._name} returns values that are not finite, at t = {when:g}"
            result[~finite] = np.nan
        return result


def run_as_step(run: Function, fields: Sequence[str]) -> Function:
    """Return a function ``(start, times, inputs, parameters)`` of whole runs as one of steps.

    It returns arrays ``(time, *grid)`` by field. Inputs are constant over a step.
    """

    def step(
        state: Any, t: Any, dt: Any, inputs: Mapping[str, Any], parameters: Mapping[str, float]
    ) -> Mapping[str, Any]:
        constant = {name: np.stack([value, value]) for name, value in inputs.items()}
        found = run(state, np.stack([t, t + dt]), constant, parameters)
        if not isinstance(found, Mapping):
            return found
        return {name: _last(name, as_array(found[name])) for name in fields if name in found}

    return step


def _last(name: str, values: Any) -> Any:
    if values.ndim == 0 or len(values) != 2:
        told = values.shape[0] if values.ndim else "no"
        raise ProgramError(f"returns {name} at {told} times instead of 2")
    return values[-1]
