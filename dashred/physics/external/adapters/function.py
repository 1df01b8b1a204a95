"""A function in Python as a program that steps states."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from dashred.core.errors import InputError
from dashred.physics.external.adapter import ANY_TIME, SAME_TIME, SINGLE, Unread, Way
from dashred.physics.external.adapters.call_limit import OverrunError, time_limit
from dashred.physics.external.adapters.patience import Patience
from dashred.physics.external.adapters.user_code import last_words, load, place_of
from dashred.physics.external.kept.contents import module_sha256
from dashred.physics.external.state_batch import (
    Array,
    ProgramError,
    StateBatch,
    as_array,
    read_fields,
)
from dashred.physics.external.tangents.function_tangents import (
    JVP,
    find_jvp,
    step_with_tangents,
    with_tangents,
)

# The arrays of a call are its own, so a change is without effect; a function that changes them is
# refused in the first calls, because it may also change what it has returned before.
CHECKED_CALLS = 32
TOO_LONG = "raise system.simulator.time_limit if it needs longer"
Function = Callable[..., Mapping[str, Any]]


class FunctionAdapter:
    """A function ``(state, t, dt, inputs, parameters)`` that returns the state at ``t + dt``.

    It may take one state or a batch of NumPy, and return arrays of NumPy, torch or JAX.

    Args:
        function: steps states.
        fields: of the system, in their order.
        name: of the function, for messages.
        place: location of its key in the configuration.
        limit: longest time for a state, in s (:class:`.patience.Patience`).
        contents: ``MODULE.FUNCTION`` of its contents; None for the name.
    """

    alone = (SINGLE, SAME_TIME, ANY_TIME)
    together = (ANY_TIME, SAME_TIME)
    at_once = 1

    def __init__(
        self,
        function: Function,
        fields: Sequence[str],
        name: str,
        place: str,
        limit: float = math.inf,
        contents: str | None = None,
    ) -> None:
        self._function, self._contents = function, contents or name
        self._patience = Patience(limit)
        self._is_jax, self._unchecked = False, CHECKED_CALLS
        self.fields, self.name, self.place = tuple(fields), name, place

    def with_tangents(self) -> FunctionAdapter | None:
        """Return the adapter of its jvp, for states with tangents; None if it has none."""
        jvp = find_jvp(self._function, self.name)
        if jvp is None:
            return None
        step, fields = step_with_tangents(jvp, self.fields), with_tangents(self.fields)
        name = f"{JVP} of {self.name}"
        limit = self._patience.limit
        return FunctionAdapter(step, fields, name, self.place, limit, self._contents)

    def call(self, batch: StateBatch, way: Way, time: Unread | None = None) -> Array:
        """See :meth:`dashred.physics.external.adapter.Adapter.call`."""
        if not (way.batch and self._is_jax):
            return self._call(batch, way, time)
        # JAX compiles a function for each size of a batch: there are few powers of two.
        rows = np.arange(1 << (len(batch) - 1).bit_length())
        return self._call(batch.take(np.minimum(rows, len(batch) - 1)), way, time)[: len(batch)]

    def _call(self, batch: StateBatch, way: Way, time: Unread | None) -> Array:
        states = batch.states if way.batch else batch.states[0]
        each = np.moveaxis(states, 1, 0) if way.batch else states
        # Indexed with (), a single number is a scalar, which code for numbers expects.
        state = {name: np.array(each[i])[()] for i, name in enumerate(self.fields)}
        kept = dict(state)
        ones = [1] * (batch.states.ndim - 2)

        def clock(values: Array) -> Any:
            return values.reshape(-1, *ones).copy() if way.arrays else float(values[0])

        inputs = {name: clock(values) for name, values in batch.inputs.items()}
        t = clock(batch.t) if time is None else time
        longest = self._patience.of(len(batch))
        try:
            # A state that blows up is reported as such, not as a warning of NumPy.
            with np.errstate(all="ignore"), self._patience.call(len(batch)), time_limit(longest):
                found = self._function(state, t, clock(batch.dt), inputs, dict(batch.parameters))
        except ProgramError:
            raise
        except OverrunError as error:
            what = f"has not ended after {longest:.3g} s{place_of(error)}"
            raise ProgramError(what, TOO_LONG) from error
        except (Exception, SystemExit) as error:  # user code may raise any exception
            raise ProgramError(f"fails: {last_words(error)}") from error
        if self._unchecked:
            self._unchecked -= 1
            _check_unchanged(kept, dict(zip(self.fields, each, strict=True)))
        result = read_fields(found, self.fields, each.shape[1:])
        self._is_jax = type(found[self.fields[0]]).__module__.startswith("jax")
        return np.moveaxis(result, 0, 1) if way.batch else result[None]

    def sha256(self) -> str:
        """See :meth:`dashred.physics.external.adapter.Adapter.sha256`."""
        return module_sha256(self._contents)


def open_function(name: str, fields: Sequence[str], place: str, limit: float) -> FunctionAdapter:
    """Import a function that steps states.

    Raises:
        InputError: it cannot be imported.
    """
    return FunctionAdapter(_imported(name, place), fields, name, place, limit)


def open_run(name: str, fields: Sequence[str], place: str, limit: float) -> FunctionAdapter:
    """Import a function of whole runs.

    Raises:
        InputError: it cannot be imported.
    """
    step = run_as_step(_imported(name, place), fields)
    return FunctionAdapter(step, fields, name, place, limit)


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


def _check_unchanged(given: Mapping[str, Any], before: Mapping[str, Array]) -> None:
    for name, values in given.items():
        if not np.array_equal(values, before[name], equal_nan=True):
            hint = f'copy it first: {name} = state["{name}"].copy()'
            raise ProgramError(f"changes its argument: the array of {name}", hint)


def _last(name: str, values: Any) -> Any:
    if values.ndim == 0 or len(values) != 2:
        told = values.shape[0] if values.ndim else "no"
        raise ProgramError(f"returns {name} at {told} times instead of 2")
    return values[-1]


def _imported(name: str, place: str) -> Function:
    try:
        function = load(name, place)
    except InputError:
        raise
    except Exception as error:  # user code may raise any exception
        hint = "its module must be in the current folder, or installed"
        what = f"{name} cannot be imported: {last_words(error)}"
        raise InputError(what, where=place, hint=hint) from error
    if not callable(function):
        raise InputError(f"{name} is not a function", where=place)
    return function
