"""Times and inputs of the steps of all segments."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from dashred.inference.segments.segments import Array, Segments
from dashred.inference.segments.steps.divided_intervals import divided
from dashred.physics.system import System

# Halves of a step of the added terms, about one step of a program.
HALVES = 2


class SegmentClock:
    """Times and inputs of the steps of a Runge–Kutta method over all segments.

    Args:
        systems: of each episode, with its inputs.
        segments: of the record.
        parts: steps from one sample to the next, if no input jumps in between.
        stages: c of the method, the times of its stages as shares of a step.

    Attributes:
        steps: lengths of the steps, ``(step, segment)``.
    """

    def __init__(
        self, systems: Sequence[System], segments: Segments, parts: int, stages: Sequence[float]
    ) -> None:
        self._systems, self._segments, self._stages = systems, segments, stages
        jumps = [system.jumps for system in systems]
        self._begins, self.steps = divided(segments, parts, jumps)

    def at(self, t: Array) -> dict[str, Array]:
        """Return time and inputs at times ``(segment, …)``, of the same shape each."""
        found = {"t": t}
        for episode, system in enumerate(self._systems):
            mine = self._segments.episode == episode
            for name, values in system.input_signals.at(t[mine]).items():
                found.setdefault(name, np.empty_like(t))[mine] = values
        return found

    def at_stage(self, step: int, stage: int) -> dict[str, Array]:
        """Return time and inputs at one stage of a step, ``(segment,)`` each."""
        return self._at_stages[step][stage]

    def of_program(self, step: int) -> tuple[Array, Array, dict[str, Array]]:
        """Return begin, length, and the inputs in the middle of a step of the program.

        All are ``(segment,)``.

        Args:
            step: the first of its two halves.
        """
        begins, halves = self._begins[step], self.steps[step]
        named = self.at(begins + halves)
        return begins, HALVES * halves, {name: named[name] for name in self._systems[0].inputs}

    @cached_property
    def _at_stages(self) -> list[list[dict[str, Array]]]:
        """Time and inputs at every stage of every step: every run needs the same."""
        return [
            [self.at(begin + share * h) for share in self._stages]
            for begin, h in zip(self._begins, self.steps, strict=True)
        ]
