"""How a function behaves: found by a few calls before the first step."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dashred.physics.external.calls import (
    ANY_TIME,
    SAME_TIME,
    SINGLE,
    Function,
    Unread,
    Way,
    call,
)
from dashred.physics.external.state_batch import Array, ProgramError, StateBatch

# Results that should be equal may differ by this many rounding errors of the largest value.
ROUNDING_ERRORS = 32
# Relative change that gives a second state, which a wrong batch would mix with the first.
CHANGE = 0.1
# Size of a field of zeros in the second state, as a share of the largest value of the first.
OF_ZEROS = 1e-3


@dataclass(frozen=True)
class Conduct:
    """How a function is called, and what a call costs.

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


def examine(function: Function, fields: Sequence[str], start: StateBatch) -> Conduct:
    """Find how a function may be called, and check that it keeps to the protocol.

    Args:
        function: the user's function.
        fields: of the system.
        start: one state.

    Raises:
        ProgramError: it fails, changes its argument, does not return a state, returns values that
            are not finite, or does not return the same for the same state.
    """
    one, first = _first_call(function, fields, start)
    if not np.isfinite(first).all():
        name = fields[int(np.argmin(np.isfinite(first[0]).reshape(len(fields), -1).all(1)))]
        raise ProgramError(f"returns values of {name} that are not finite, at t = {start.t[0]:g}")
    other = replace(start, states=_changed(start.states))
    second = call(function, fields, other, one)
    began = time.perf_counter()
    again = call(function, fields, start, one)
    seconds = time.perf_counter() - began
    rounding = _rounding(other.states, second)
    if not equal(first, again, rounding):
        hint = "a state must hold all that the function remembers; random numbers need a fixed seed"
        size = np.abs(first - again).max()
        raise ProgramError(f"returns results that differ by {size:.3g} for the same state", hint)
    together, expected = _joined(start, other), np.concatenate([first, second])

    def agrees(time: Unread | None = None) -> bool:
        found = _tried(function, fields, together, SAME_TIME, time)
        return found is not None and equal(found, expected, rounding)

    if _takes_many_times(function, fields, start, other, one, rounding):
        return Conduct(ANY_TIME, one, True, True, rounding, seconds)
    if agrees():
        return Conduct(SAME_TIME, one, True, not agrees(Unread()), rounding, seconds)
    return Conduct(one, one, False, True, rounding, seconds)


def _first_call(function: Function, fields: Sequence[str], start: StateBatch) -> tuple[Way, Array]:
    """Return the simplest way to call a function with one state, and its result."""
    errors = []
    for way in (SINGLE, SAME_TIME, ANY_TIME):
        try:
            return way, call(function, fields, start, way)
        except ProgramError as error:
            errors.append(error)
    raise errors[0]


def _takes_many_times(
    function: Function,
    fields: Sequence[str],
    start: StateBatch,
    other: StateBatch,
    one: Way,
    rounding: float,
) -> bool:
    """Whether a batch may have several times and lengths of steps."""
    later = replace(start, t=start.t + start.dt, dt=start.dt / 2)
    expected = [_tried(function, fields, each, one) for each in (later, other)]
    found = _tried(function, fields, _joined(later, other), ANY_TIME)
    if found is None or expected[0] is None or expected[1] is None:
        return False
    return equal(found, np.concatenate([expected[0], expected[1]]), rounding)


def _tried(
    function: Function,
    fields: Sequence[str],
    batch: StateBatch,
    way: Way,
    time: Unread | None = None,
) -> Array | None:
    try:
        return call(function, fields, batch, way, time)
    except ProgramError:
        return None


def _joined(a: StateBatch, b: StateBatch) -> StateBatch:
    inputs = {name: np.concatenate([a.inputs[name], b.inputs[name]]) for name in a.inputs}
    return StateBatch(
        np.concatenate([a.states, b.states]),
        np.concatenate([a.t, b.t]),
        np.concatenate([a.dt, b.dt]),
        inputs,
        a.parameters,
    )


def _changed(states: Array) -> Array:
    """Return states with each field changed by a smooth factor, and none of only zeros."""
    wave = np.ones(states.shape[2:])
    for places in np.indices(wave.shape):
        wave *= np.cos(2 * np.pi * places / (places.max() + 1))
    zero = ~states.any(axis=tuple(range(2, states.ndim)), keepdims=True)
    largest = np.abs(states).max() or 1.0
    return states * (1 + CHANGE * wave) + zero * OF_ZEROS * largest * wave


def _rounding(before: Array, after: Array) -> float:
    """Return the rounding error of results, by the number of digits that they use."""
    for kind in (np.float16, np.float32):
        # A state that itself has few digits shows nothing.
        if _fits(after, kind) and not _fits(before, kind):
            return float(np.finfo(kind).eps) / 2
    return float(np.finfo(np.float64).eps) / 2


def _fits(values: Array, kind: type[np.floating]) -> bool:
    with np.errstate(over="ignore"):
        return bool((values == values.astype(kind)).all())


def equal(a: Array, b: Array, rounding: float) -> bool:
    """Whether two batches of states are equal to within rounding, field by field."""
    grid = tuple(range(2, a.ndim))
    scale = np.abs(b).max(axis=(0, *grid), keepdims=True)
    return bool((np.abs(a - b) <= ROUNDING_ERRORS * rounding * scale).all())
