"""Tangents of an FMU for model exchange, from its directional derivatives.

A tangent δ of the states x follows, with the derivatives f of the FMU::

    x' = f(x, t)        δ' = f'(x, t) δ

The states are those of :mod:`.integration`. Between some of them δ is stepped with the method of
Runge and Kutta, which needs f' at three equidistant states.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dashred.core.progress import say
from dashred.physics.external.adapter import ANY_TIME, Unread, Way
from dashred.physics.external.fmu.fmu import FmuAdapter, Given
from dashred.physics.external.state_batch import Array, ProgramError, StateBatch
from dashred.physics.external.tangents.checked_tangents import MOST_ERROR
from dashred.physics.external.tangents.function_tangents import with_tangents

# Steps of the states in half a step of a tangent: it needs fewer digits than they do.
STRIDES = (2, 1)
# Relative change of a state in a difference of its end, and of its derivatives.
CHANGE, CHECK = 1e-7, 1e-5


class Point(NamedTuple):
    """A state on the way: ``f'(x, t)`` times directions, ``(state, direction)``."""

    t: float
    product: Callable[[Array], Array]


class _RefusedError(Exception):
    """The directional derivatives cannot be used."""


class FmuTangents:
    """The adapter of an FMU with directional derivatives, for states with tangents.

    At an event, and from an error of the FMU or a wrong derivative on, differences of steps take
    their place.

    Args:
        own: the adapter of the FMU for model exchange, which offers them.
    """

    parallel = False
    alone = together = (ANY_TIME,)

    def __init__(self, own: FmuAdapter) -> None:
        self._own, self._is_checked, self._is_refused = own, False, False
        self.fields, self.place = with_tangents(own.fields), own.place
        self.name = f"the directional derivatives of {own.name}"

    def call(self, batch: StateBatch, way: Way, time: Unread | None = None) -> Array:
        """See :meth:`dashred.physics.external.adapter.Adapter.call`."""
        states, tangents = np.split(batch.states, 2, axis=1)
        plain, after = replace(batch, states=states), np.empty_like(batch.states)
        for rows in _same_starts(plain):
            given = self._own.given(plain, int(rows[0]))
            with np.errstate(all="ignore"):
                end, moved = self._step(given, tangents[rows].T)
            after[rows] = np.concatenate([np.tile(end, (len(rows), 1)), moved.T], axis=1)
        return after

    def sha256(self) -> str:
        """See :meth:`dashred.physics.external.adapter.Adapter.sha256`."""
        return self._own.sha256()

    def _step(self, given: Given, tangents: Array) -> tuple[Array, Array]:
        """Return the state ``(field,)`` and its tangents ``(field, tangent)`` after a step."""
        if not self._is_refused:
            try:
                found = self._integrate(given, self._own.ordered(tangents))
            except _RefusedError as error:
                self._is_refused = True
                say(f"{self._own.name}: {error}; differences are used in their place")
            else:
                if found is not None:
                    return self._own.of_fields(found[0]), self._own.of_fields(found[1])
        return self._by_differences(given, tangents)

    def _integrate(self, given: Given, tangents: Array) -> tuple[Array, Array] | None:
        """Return states and tangents ``(state, tangent)`` after a step; None if it has an event.

        Raises:
            _RefusedError: the directional derivatives cannot be used.
        """
        steps = self._own.steps_of(given)
        # A longer stride must not take many more steps.
        stride = next(s for s in STRIDES if _whole(steps, 2 * s) <= max(steps + 1, 1.2 * steps))
        t, x = given.t, self._own.ordered(given.state)
        on_way = [(t, x)]
        for i, reached in enumerate(self._own.follow(given, _whole(steps, 2 * stride)), start=1):
            if reached.is_event:
                return None
            t, x = reached.t, reached.x
            if not np.isfinite(x).all():
                return x, np.full_like(tangents, np.nan)
            if i % stride == 0:
                on_way.append((t, x))
        points = [self._point(*each, tangents.shape[1]) for each in on_way]
        ends = [*pairwise(points[::2])]
        for (begin, end), middle in zip(ends, points[1::2], strict=True):
            tangents = _carry(begin, middle, end, tangents)
        return x, tangents

    def _point(self, t: float, x: Array, count: int) -> Point:
        """Return f' at a state, to be multiplied with so many directions about twice."""
        if not self._is_checked:
            self._check(t, x)
            self._is_checked = True
        if 2 * count < len(x):
            return Point(t, lambda directions: self._along(t, x, directions))
        jacobian = self._along(t, x, np.eye(len(x)))
        return Point(t, lambda directions: jacobian @ directions)

    def _along(self, t: float, x: Array, directions: Array) -> Array:
        try:
            return self._own.instance.slopes_along(t, x, directions)
        except ProgramError as error:
            raise _RefusedError(
                f"it says that it has directional derivatives, but {error}"
            ) from None

    def _check(self, t: float, x: Array) -> None:
        """Compare the derivatives of f by each state with central differences.

        Raises:
            _RefusedError: they differ.
        """
        size = _sizes(x)
        found, slopes = self._along(t, x, np.diag(size)), self._own.instance.slopes
        ends = [[slopes(t, x + s * CHECK * row) for s in (1, -1)] for row in np.diag(size)]
        expected = np.array([(after - before) / (2 * CHECK) for after, before in ends]).T
        scale = np.abs(expected).max(axis=1, keepdims=True)
        # The rounding errors of f are large in a difference.
        uncertain = 1e-9 * np.abs(slopes(t, x))[:, None]
        if not (np.abs(found - expected) <= MOST_ERROR * scale + uncertain).all():
            raise _RefusedError("its directional derivatives differ from those of its derivatives")

    def _by_differences(self, given: Given, tangents: Array) -> tuple[Array, Array]:
        """Return what :meth:`_step` does, by one-sided differences."""
        end, moved = self._own.step(given), np.zeros_like(tangents)
        reach = np.abs(tangents / _sizes(given.state)[:, None]).max(axis=0)
        for j in np.flatnonzero(reach > 0):
            change = CHANGE / reach[j]
            other = self._own.step(given._replace(state=given.state + change * tangents[:, j]))
            moved[:, j] = (other - end) / change
        return end, moved


def _carry(begin: Point, middle: Point, end: Point, tangents: Array) -> Array:
    """Return the tangents ``(state, tangent)`` after a step of the method of Runge and Kutta."""
    h = end.t - begin.t
    k1 = begin.product(tangents)
    k2 = middle.product(tangents + h / 2 * k1)
    k3 = middle.product(tangents + h / 2 * k2)
    k4 = end.product(tangents + h * k3)
    return tangents + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def _whole(steps: int, parts: int) -> int:
    """Return the next multiple of a number of parts."""
    return -(-steps // parts) * parts


def _sizes(x: Array) -> Array:
    """Return the size of each value, or the largest one for a value of zero."""
    return np.where(x == 0, np.abs(x).max() or 1.0, np.abs(x))


def _same_starts(batch: StateBatch) -> Iterator[NDArray[np.intp]]:
    """Yield the rows that begin with the same state at the same time."""
    starts = np.column_stack([batch.states, batch.t, batch.dt, *batch.inputs.values()])
    _, group = np.unique(starts, axis=0, return_inverse=True)
    for index in range(int(group.max()) + 1):
        yield np.flatnonzero(group.reshape(-1) == index)
