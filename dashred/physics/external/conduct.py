"""How a program behaves: found by a few calls before the first step."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dashred.physics.external.adapter import ANY_TIME, SAME_TIME, Adapter, Unread, Way
from dashred.physics.external.state_batch import Array, ProgramError, StateBatch

# Results that should be equal may differ by this many rounding errors of the largest value.
ROUNDING_ERRORS = 32
# Relative change that gives a second state, which a wrong batch would mix with the first.
CHANGE = 0.1
# Length of a line of states on which results show their rounding, relative to the states.
CLOSE, CLOSE_STATES = 1e-5, 8
GOLDEN = (5**0.5 - 1) / 2
LEAST_ROUNDING = float(np.finfo(np.float64).eps) / 2
# Size of a field of zeros in the second state, as a share of the largest value of the first.
OF_ZEROS = 1e-3
# Two half steps differ from one step by more than this share of a step's change only if the length
# of the step is not used, or if a state does not mean the same at both ends.
MOST_DIFFERENCE = 0.75
NOT_A_STEP = """\
does it step by dt from the given state, and return the fields in the order and units in which it \
takes them? A program that has only one dt must fail for any other."""


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
    rounding = _rounding(adapter, start, one)
    if not equal(first, again, LEAST_ROUNDING):
        hint = "a state must hold all that the program remembers; random numbers need a fixed seed"
        size = np.abs(first - again).max()
        raise ProgramError(f"returns results that differ by {size:.3g} for the same state", hint)
    if np.array_equal(first, second):
        raise ProgramError("returns the same for different states", NOT_A_STEP)
    _check_halves(adapter, start, first, one, rounding)
    later = replace(start, t=start.t + start.dt, dt=start.dt / 2)
    if _agrees(adapter, [(later, None), (other, second)], ANY_TIME, one, rounding):
        return Conduct(ANY_TIME, one, True, True, rounding, seconds)
    pair = [(start, first), (other, second)]
    if _agrees(adapter, pair, SAME_TIME, one, rounding):
        reads_time = not _agrees(adapter, pair, SAME_TIME, one, rounding, Unread())
        return Conduct(SAME_TIME, one, True, reads_time, rounding, seconds)
    return Conduct(one, one, False, True, rounding, seconds)


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


def _check_halves(
    adapter: Adapter, start: StateBatch, whole: Array, one: Way, rounding: float
) -> None:
    """Check that two half steps give about the same state as one step."""
    half = replace(start, dt=start.dt / 2)
    middle = _tried(adapter, half, one)
    if middle is None:
        return
    rest = replace(half, t=half.t + half.dt, states=middle)
    halves = _tried(adapter, rest, one)
    if halves is None or equal(halves, whole, rounding):
        return
    grid = tuple(range(2, whole.ndim))
    scale = np.maximum(np.abs(start.states), np.abs(whole)).max(axis=grid, keepdims=True)
    scale = np.where(scale > 0, scale, 1.0)
    difference = float(np.linalg.norm((halves - whole) / scale))
    change = float(np.linalg.norm((whole - start.states) / scale))
    if difference > MOST_DIFFERENCE * change + ROUNDING_ERRORS * rounding:
        what = f"steps by {change:.3g} of the state in one step of {start.dt[0]:g}, but two half "
        raise ProgramError(f"{what}steps end {difference:.3g} from there", NOT_A_STEP)


def _agrees(
    adapter: Adapter,
    cases: Sequence[tuple[StateBatch, Array | None]],
    way: Way,
    one: Way,
    rounding: float,
    time: Unread | None = None,
) -> bool:
    """Whether a call with two states gives what two calls give; None is not known yet."""
    if way not in adapter.together:
        return False
    expected = [_tried(adapter, b, one) if known is None else known for b, known in cases]
    found = _tried(adapter, _joined(cases[0][0], cases[1][0]), way, time)
    if found is None or expected[0] is None or expected[1] is None:
        return False
    return equal(found, np.concatenate([expected[0], expected[1]]), rounding)


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


def _rounding(adapter: Adapter, start: StateBatch, one: Way) -> float:
    """Return the relative error of rounding and of tolerances, from the results of close states.

    Along a short line of states a result is a cubic but for these errors. The places on the line
    are irregular, because equal distances may be whole numbers of the last digit.
    """
    sizes = np.random.default_rng(0).uniform(0.5, 1.5, start.states.shape)
    line = CLOSE * sizes * _scale(start.states)
    places = np.arange(CLOSE_STATES) * GOLDEN % 1
    results = []
    for place in places:
        found = _tried(adapter, replace(start, states=start.states + place * line), one)
        if found is None or not np.isfinite(found).all():
            return LEAST_ROUNDING
        results.append(found[0])
    values = np.stack(results)
    flat = (values - values[0]).reshape(CLOSE_STATES, -1)
    _, squares, *_ = np.linalg.lstsq(np.vander(places, 4), flat, rcond=None)
    errors = np.sqrt(squares / (CLOSE_STATES - 4)).reshape(values.shape[1:])
    scale = _scale(values).max(axis=0)
    return max(LEAST_ROUNDING, float((errors / scale).max()))


def _scale(states: Array) -> Array:
    """Return the largest value of each field, or of the state for a field of zeros."""
    largest = np.abs(states).max(axis=tuple(range(2, states.ndim)), keepdims=True)
    return np.where(largest > 0, largest, np.abs(states).max() or 1.0)


def equal(a: Array, b: Array, rounding: float) -> bool:
    """Whether two batches of states are equal to within rounding, field by field."""
    grid = tuple(range(2, a.ndim))
    scale = np.abs(b).max(axis=(0, *grid), keepdims=True)
    with np.errstate(invalid="ignore"):
        return bool(((a == b) | (np.abs(a - b) <= ROUNDING_ERRORS * rounding * scale)).all())
