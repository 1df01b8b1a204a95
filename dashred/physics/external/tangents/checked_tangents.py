"""Tangents of a program, compared with its differences once."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dashred.core.errors import InputError
from dashred.physics.external.protocol import Array, Program, Stepper
from dashred.physics.external.state_batch import StateBatch

# Largest error of a tangent, as a share of its largest value. A wrong one differs by more.
MOST_ERROR = 0.05


class CheckedTangents:
    """Steps states with tangents; the first call compares a tangent with a central difference.

    Args:
        tangent: the program that steps both, ``(batch, 2 field, *grid)``.
        program: the program that steps states.
        name: of the tangents, for messages.
        place: location of the program in the configuration.
    """

    def __init__(self, tangent: Stepper, program: Program, name: str, place: str) -> None:
        self._tangent, self._program = tangent, program
        self._name, self._place, self._is_checked = name, place, False

    def step(
        self,
        states: Array,
        t: Array,
        dt: Array,
        inputs: Mapping[str, Array],
        parameters: Mapping[str, float],
    ) -> Array:
        """See :meth:`dashred.physics.external.protocol.Program.step`.

        Raises:
            InputError: the tangents are not those of the program.
        """
        found = self._tangent.step(states, t, dt, inputs, parameters)
        if self._is_checked:
            return found
        sizes = _sizes(states)
        own, moved = np.split(sizes, 2, axis=1)
        finite = np.isfinite(sizes).all(axis=1) & np.isfinite(_sizes(found)).all(axis=1)
        largest = own[finite].max(axis=0, initial=0.0)
        # A direction along a field of zeros has no known size: a later call has one.
        suitable = finite & (moved > 0).any(axis=1) & ~((moved > 0) & (largest == 0)).any(axis=1)
        rows = np.flatnonzero(suitable)[:1]
        if rows.size:
            self._is_checked = True
            moving = moved[rows[0]] > 0
            reach = float((largest[moving] / moved[rows[0], moving]).min())
            one = StateBatch(states, t, dt, inputs, parameters).take(rows)
            self._check(one, found[rows], reach)
        return found

    def _check(self, one: StateBatch, found: Array, reach: float) -> None:
        """Compare a state and its tangent with a central difference.

        Args:
            one: a state with a tangent, ``(1, 2 field, *grid)``.
            found: what the tangent's program has returned for it.
            reach: how far along the tangent a field first changes by its own size.

        Raises:
            InputError: they differ.
        """
        own, direction = np.split(one.states, 2, axis=1)
        step = self._program.rounding ** (1 / 3) * reach
        ends = [
            self._program.step(
                own + sign * step * direction, one.t, one.dt, one.inputs, one.parameters
            )
            for sign in (-1, 0, 1)
        ]
        after, moved = np.split(found, 2, axis=1)
        # The rounding errors of the program are large in a difference if a field is small.
        rounding = self._program.rounding * np.abs(ends[1]) / step
        compared = (
            ("state", after, ends[1], 0.0),
            ("tangent", moved, (ends[2] - ends[0]) / (2 * step), rounding),
        )
        for what, given, expected, uncertain in compared:
            error = (np.abs(given - expected) - uncertain).max()
            scale = np.abs(expected).max()
            if np.isfinite(expected).all() and error > MOST_ERROR * max(scale, 1e-100):
                raise InputError(
                    f"the {what} that {self._name} returns differs from that of the program by "
                    f"{error / max(scale, 1e-100):.2g} of its largest value",
                    where=self._place,
                    hint="correct it or remove it: without one, differences are used",
                )


def _sizes(states: Array) -> Array:
    """Return the largest value of each field, ``(batch, field)``."""
    return np.asarray(np.abs(states).max(axis=tuple(range(2, states.ndim))))
