"""A few calls before the first step, which find how a program behaves."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dashred.core.threads import in_threads
from dashred.physics.external.adapter import ANY_TIME, SAME_TIME, Adapter, Unread, Way
from dashred.physics.external.conduct import Conduct
from dashred.physics.external.rounding import (
    DOUBLE,
    ROUNDING_ERRORS,
    SINGLE_PRECISION,
    equal,
    measured_rounding,
)
from dashred.physics.external.state_batch import Array, ProgramError, StateBatch

# Relative change that gives a second state, which a wrong batch would mix with the first.
CHANGE = 0.1
# Size of a field of zeros in the second state, as a share of the largest value of the first.
OF_ZEROS = 1e-3
# Two half steps differ from one step by more than this share of a step's change only if the length
# of the step is not used, or if a state does not mean the same at both ends.
MOST_DIFFERENCE = 0.75
NOT_A_STEP = """\
does it step by dt from the given state, and return the fields in the order and units in which it \
takes them? A program that has only one dt must fail for any other."""


def examine(adapter: Adapter, start: StateBatch) -> Conduct:
    """Find how a program may be called, and check that it keeps to the protocol.

    Args:
        adapter: of the program.
        start: one state.

    Raises:
        ProgramError: it fails, changes its argument, does not return a state, returns values that
            are not finite, does not return the same for the same state, or does not step by dt from
            the state.
    """
    one, first = _first_call(adapter, start)
    _check_finite(first, adapter, start)
    other = replace(start, states=_changed(start.states))
    second = adapter.call(other, one)
    began = time.perf_counter()
    again = adapter.call(start, one)
    seconds = time.perf_counter() - began
    if not equal(first, again, DOUBLE):
        hint = "a state must hold all that the program remembers; random numbers need a fixed seed"
        size = np.abs(first - again).max()
        raise ProgramError(f"returns results that differ by {size:.3g} for the same state", hint)
    if np.array_equal(first, second):
        raise ProgramError("returns the same for different states", NOT_A_STEP)
    _check_halves(adapter, start, first, one)
    way, many, reads_time = _way_for_many(adapter, [(start, first), (other, second)], one)
    rounding = measured_rounding(lambda close: _step(adapter, close, way, many), start)
    return Conduct(way, one, many, reads_time, rounding, seconds)


def _first_call(adapter: Adapter, start: StateBatch) -> tuple[Way, Array]:
    """Return the simplest way to call a program with one state, and its result."""
    errors = []
    for way in adapter.alone:
        try:
            return way, adapter.call(start, way)
        except ProgramError as error:
            errors.append(error)
    raise errors[0]


def _check_finite(result: Array, adapter: Adapter, start: StateBatch) -> None:
    for name, values in zip(adapter.fields, result[0], strict=True):
        if not np.isfinite(values).all():
            when = f"at t = {start.t[0]:g}"
            raise ProgramError(f"returns values of {name} that are not finite, {when}")


def _check_halves(adapter: Adapter, start: StateBatch, whole: Array, one: Way) -> None:
    """Check that two half steps give about the same state as one step."""
    half = replace(start, dt=start.dt / 2)
    middle = _tried(adapter, half, one)
    if middle is None:
        return
    rest = replace(half, t=half.t + half.dt, states=middle)
    halves = _tried(adapter, rest, one)
    if halves is None or equal(halves, whole, SINGLE_PRECISION):
        return
    grid = tuple(range(2, whole.ndim))
    scale = np.maximum(np.abs(start.states), np.abs(whole)).max(axis=grid, keepdims=True)
    scale = np.where(scale > 0, scale, 1.0)
    difference = float(np.linalg.norm((halves - whole) / scale))
    change = float(np.linalg.norm((whole - start.states) / scale))
    if difference > MOST_DIFFERENCE * change + ROUNDING_ERRORS * SINGLE_PRECISION:
        what = f"steps by {change:.3g} of the state in one step of {start.dt[0]:g}, but two half "
        raise ProgramError(f"{what}steps end {difference:.3g} from there", NOT_A_STEP)


def _way_for_many(
    adapter: Adapter, pair: Sequence[tuple[StateBatch, Array]], one: Way
) -> tuple[Way, bool, bool]:
    """Return the way to call it with many states, whether there is one, and whether it reads t."""
    (start, first), (other, second) = pair
    # A wrong batch differs by much more than the rounding of single precision.
    if ANY_TIME in adapter.together:
        later = replace(start, t=start.t + start.dt, dt=start.dt / 2)
        expected = _tried(adapter, later, one)
        found = _tried(adapter, _joined(later, other), ANY_TIME)
        if expected is not None and _agrees(found, [expected, second]):
            return ANY_TIME, True, True
    if SAME_TIME in adapter.together:
        both = _joined(start, other)
        if _agrees(_tried(adapter, both, SAME_TIME), [first, second]):
            unread = _tried(adapter, both, SAME_TIME, Unread())
            return SAME_TIME, True, not _agrees(unread, [first, second])
    return one, False, True


def _agrees(found: Array | None, expected: list[Array]) -> bool:
    """Whether a call with two states gives what two calls give."""
    return found is not None and equal(found, np.concatenate(expected), SINGLE_PRECISION)


def _step(adapter: Adapter, batch: StateBatch, way: Way, many: bool) -> Array | None:
    """Return the states after a step, or None if one fails."""
    if many:
        return _tried(adapter, batch, way)
    results: list[Array | None] = [None] * len(batch)

    def run(row: int) -> None:
        results[row] = _tried(adapter, batch.take([row]), way)

    for _ in in_threads(run, len(batch), adapter.at_once):
        pass
    known = [result for result in results if result is not None]
    return np.concatenate(known) if len(known) == len(batch) else None


def _tried(
    adapter: Adapter, batch: StateBatch, way: Way, time: Unread | None = None
) -> Array | None:
    try:
        return adapter.call(batch, way, time)
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
