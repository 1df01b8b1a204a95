"""Tangents of an FMU for model exchange, from its directional derivatives.

A tangent δ of the states x follows, with the derivatives f of the FMU::

    x' = f(x, t)        δ' = f'(x, t) δ

Both are stepped by one method of Runge and Kutta, so that δ is the derivative of the discrete x.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dashred.core.progress import say
from dashred.physics.external.adapter import ANY_TIME, Unread, Way
from dashred.physics.external.adapters.fmu.fmu import FmuAdapter, Given
from dashred.physics.external.adapters.fmu.instance import Instance, NoDerivativesError
from dashred.physics.external.state_batch import Array, StateBatch
from dashred.physics.external.tangents.checked_tangents import MOST_ERROR
from dashred.physics.external.tangents.function_tangents import with_tangents

# Relative change of a state in a difference of its end, and of its derivatives.
CHANGE, CHECK = 1e-7, 1e-5


@dataclass
class _Tangents:
    """Tangents that are carried along the steps of the states, ``(state, tangent)``."""

    values: Array

    def step(self, instance: Instance, x: Array, t: float, h: float) -> Array:
        """Return the states after a step of the classical method, and move the tangents."""
        d = self.values
        k1, m1 = instance.slopes_along(t, x, d)
        k2, m2 = instance.slopes_along(t + h / 2, x + h / 2 * k1, d + h / 2 * m1)
        k3, m3 = instance.slopes_along(t + h / 2, x + h / 2 * k2, d + h / 2 * m2)
        k4, m4 = instance.slopes_along(t + h, x + h * k3, d + h * m3)
        self.values = d + h / 6 * (m1 + 2 * m2 + 2 * m3 + m4)
        return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


class FmuTangents:
    """The adapter of an FMU with directional derivatives, for states with tangents.

    At an event, and from an error of the FMU or a wrong derivative on, differences of steps take
    their place.

    Args:
        own: the adapter of the FMU for model exchange, which offers them.
    """

    at_once = 1
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
        found = None if self._is_refused else self._integrate(given, self._own.ordered(tangents))
        if found is None:
            return self._by_differences(given, tangents)
        return self._own.of_fields(found[0]), self._own.of_fields(found[1])

    def _integrate(self, given: Given, tangents: Array) -> tuple[Array, Array] | None:
        """Return states and tangents ``(state, tangent)`` after a step.

        None if the step has an event, or the directional derivatives cannot be used.
        """
        carried, x = _Tangents(tangents), self._own.ordered(given.state)
        steps = self._own.steps_of(given)
        try:
            for reached in self._own.follow(given, steps, carried.step):
                if reached.is_event:
                    return None
                x = reached.x
        except NoDerivativesError as error:
            self._own.reset()
            self._refuse(f"it says that it has directional derivatives, but {error}")
            return None
        if not self._is_checked and np.isfinite(x).all():
            self._is_checked = True
            if not self._is_right(given.t + given.dt, x):
                self._refuse("its directional derivatives are not those of its derivatives")
                return None
        return x, carried.values

    def _refuse(self, why: str) -> None:
        self._is_refused = True
        say(f"{self._own.name}: {why}; differences are used in their place")

    def _is_right(self, t: float, x: Array) -> bool:
        """Whether the derivatives of f by each state are about central differences."""
        size, slopes = _sizes(x), self._own.instance.slopes
        rates, found = self._own.instance.slopes_along(t, x, np.diag(size))
        ends = [[slopes(t, x + s * CHECK * row) for s in (1, -1)] for row in np.diag(size)]
        expected = np.array([(after - before) / (2 * CHECK) for after, before in ends]).T
        scale = np.abs(expected).max(axis=1, keepdims=True)
        # The rounding errors of f are large in a difference.
        uncertain = 1e-9 * np.abs(rates)[:, None]
        return bool((np.abs(found - expected) <= MOST_ERROR * scale + uncertain).all())

    def _by_differences(self, given: Given, tangents: Array) -> tuple[Array, Array]:
        """Return what :meth:`_step` does, by one-sided differences."""
        end, moved = self._own.step(given), np.zeros_like(tangents)
        reach = np.abs(tangents / _sizes(given.state)[:, None]).max(axis=0)
        for j in np.flatnonzero(reach > 0):
            change = CHANGE / reach[j]
            other = self._own.step(given._replace(state=given.state + change * tangents[:, j]))
            moved[:, j] = (other - end) / change
        return end, moved


def _sizes(x: Array) -> Array:
    """Return the size of each value, or the largest one for a value of zero."""
    return np.where(x == 0, np.abs(x).max() or 1.0, np.abs(x))


def _same_starts(batch: StateBatch) -> Iterator[NDArray[np.intp]]:
    """Yield the rows that begin with the same state at the same time."""
    starts = np.column_stack([batch.states, batch.t, batch.dt, *batch.inputs.values()])
    _, group = np.unique(starts, axis=0, return_inverse=True)
    for index in range(int(group.max()) + 1):
        yield np.flatnonzero(group.reshape(-1) == index)
