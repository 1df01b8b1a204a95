"""A step of a program from the states of all segments, with its Jacobian."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dashred.inference.segments.segments import Array
from dashred.physics.external.protocol import Program

# Smallest change in a difference, as a share of the largest value of any field.
SMALLEST = 1e-12


@dataclass(frozen=True)
class ProgramStep:
    """A program of a system without axes.

    Attributes:
        program: steps states.
        parameters: its parameters by name.
    """

    program: Program
    parameters: Mapping[str, float]

    def advance(self, x: Array, t: Array, h: Array, inputs: Mapping[str, Array]) -> Array:
        """Return the states after a step, ``(segment, field)``.

        Args:
            x: ``(segment, field)``.
            t: time of each, ``(segment,)``.
            h: step of each, ``(segment,)``.
            inputs: in the middle of the step, ``(segment,)`` each.
        """
        return self.program.step(x, t, h, inputs, self.parameters)

    def linearise(
        self, x: Array, t: Array, h: Array, inputs: Mapping[str, Array]
    ) -> tuple[Array, Array]:
        """Return the states after a step, and their Jacobian ``(segment, field, field)``.

        It comes from one-sided differences; all segments and fields are one batch.
        """
        count, fields = x.shape
        known = np.where(np.isfinite(x), np.abs(x), 0.0)
        reach = np.maximum(known.max(axis=0), SMALLEST * max(1.0, float(known.max())))
        small = self.program.rounding**0.5 * reach
        moved = x[None] + small[:, None, None] * np.eye(fields)[:, None, :]
        whole = np.concatenate([x[None], moved]).reshape(-1, fields)

        def repeated(values: Array) -> Array:
            return np.tile(values, fields + 1)

        each = {name: repeated(values) for name, values in inputs.items()}
        ends = self.advance(whole, repeated(t), repeated(h), each).reshape(-1, count, fields)
        slopes = (ends[1:] - ends[0]) / small[:, None, None]
        return ends[0], np.moveaxis(slopes, 0, -1)
