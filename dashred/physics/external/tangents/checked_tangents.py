"""Tangents of a program, compared with its differences once."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dashred.core.errors import InputError
from dashred.physics.external.protocol import Array, Program, Stepper

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
        fields = states.shape[1] // 2
        rows = np.flatnonzero(np.isfinite(found).reshape(len(found), -1).all(axis=1))
        moved = np.abs(states[rows, fields:]).reshape(len(rows), -1).max(axis=1)
        if not self._is_checked and (moved > 0).any():
            self._is_checked = True
            row = rows[[int(np.argmax(moved > 0))]]
            each = {name: values[row] for name, values in inputs.items()}
            self._check(states[row], found[row], t[row], dt[row], each, parameters)
        return found

    def _check(
        self,
        state: Array,
        found: Array,
        t: Array,
        dt: Array,
        inputs: Mapping[str, Array],
        parameters: Mapping[str, float],
    ) -> None:
        own, direction = np.split(state, 2, axis=1)
        size = self._program.rounding ** (1 / 3) * max(float(np.abs(own).max()), 1e-100)
        step = size / float(np.abs(direction).max())
        ends = [
            self._program.step(own + sign * step * direction, t, dt, inputs, parameters)
            for sign in (-1, 0, 1)
        ]
        differences = np.concatenate([ends[1], (ends[2] - ends[0]) / (2 * step)], axis=1)
        for what, part in (("state", 0), ("tangent", 1)):
            given, expected = (np.split(each, 2, axis=1)[part] for each in (found, differences))
            error, scale = np.abs(given - expected).max(), np.abs(expected).max()
            if np.isfinite(expected).all() and error > MOST_ERROR * max(scale, 1e-100):
                raise InputError(
                    f"the {what} that {self._name} returns differs from that of the program by "
                    f"{error / max(scale, 1e-100):.2g} of its largest value",
                    where=self._place,
                    hint="correct it or remove it: without one, differences are used",
                )
