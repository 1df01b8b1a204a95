"""The ways to call a function that steps states: one state, or a batch, with one time or many."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np

from dashred.physics.external.state_batch import (
    Array,
    ProgramError,
    StateBatch,
    read_fields,
)
from dashred.physics.external.user_code import last_words

Function = Callable[..., Mapping[str, Any]]


@dataclass(frozen=True)
class Way:
    """A way to call a function ``(state, t, dt, inputs, parameters)``.

    Attributes:
        batch: whether a field is ``(batch, *grid)``, else ``(*grid)``.
        arrays: whether t, dt and inputs are arrays ``(batch, *1)`` that broadcast against a field,
            else numbers.
    """

    batch: bool
    arrays: bool


SINGLE, SAME_TIME, ANY_TIME = Way(False, False), Way(True, False), Way(True, True)


class Unread:
    """A time that cannot be read: a function that returns has not used the time."""

    def _refuse(self, *_: object) -> NoReturn:
        raise ProgramError("reads the time")

    __eq__ = __ne__ = __bool__ = __str__ = __repr__ = __format__ = _refuse
    __hash__ = None  # type: ignore[assignment]


def call(
    function: Function,
    fields: Sequence[str],
    now: StateBatch,
    way: Way,
    time: Unread | None = None,
) -> Array:
    """Call a function once and return the states, ``(batch, field, *grid)``.

    Args:
        function: the user's function.
        fields: of the system.
        now: the states; one if the way has no batch, and with equal times if it has no arrays.
        way: how the function is called.
        time: takes the place of t.

    Raises:
        ProgramError: the function fails, changes its argument, or does not return a state.
    """
    states = now.states if way.batch else now.states[0]
    each = np.moveaxis(states, 1, 0) if way.batch else states
    # Indexed with (), a single number is a scalar, which code for numbers expects.
    state = {name: np.array(each[i])[()] for i, name in enumerate(fields)}
    kept = dict(state)
    ones = [1] * (now.states.ndim - 2)

    def clock(values: Array) -> Any:
        return values.reshape(-1, *ones).copy() if way.arrays else float(values[0])

    inputs = {name: clock(values) for name, values in now.inputs.items()}
    t = clock(now.t) if time is None else time
    try:
        # A state that blows up is reported as such, not as a warning of NumPy.
        with np.errstate(all="ignore"):
            found = function(state, t, clock(now.dt), inputs, dict(now.parameters))
    except ProgramError:
        raise
    except (Exception, SystemExit) as error:  # user code may raise any exception
        raise ProgramError(f"fails: {last_words(error)}") from error
    for i, name in enumerate(fields):
        if not np.array_equal(kept[name], each[i], equal_nan=True):
            hint = f'copy it first: {name} = state["{name}"].copy()'
            raise ProgramError(f"changes its argument: the array of {name}", hint)
    shape = each.shape[1:]
    result = read_fields(found, fields, shape)
    return np.moveaxis(result, 0, 1) if way.batch else result[None]
