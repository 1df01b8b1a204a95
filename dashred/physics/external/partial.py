"""A program that steps some of the fields."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dashred.physics.external.protocol import Array, Program, Stepper


@dataclass(frozen=True)
class PartialProgram:
    """A program beside fields that it does not know: it leaves them as they are.

    Attributes:
        program: steps its own fields.
        places: indices of these in the state.
        count: number of fields of the state.
    """

    program: Program
    places: Sequence[int]
    count: int

    @property
    def tangent(self) -> Stepper | None:
        """See :class:`.protocol.Program`."""
        tangent = self.program.tangent
        if tangent is None:
            return None
        return _PartialStepper(tangent, [*self.places, *(self.count + i for i in self.places)])

    @property
    def rounding(self) -> float:
        """See :class:`.protocol.Program`."""
        return self.program.rounding

    @property
    def seconds(self) -> float:
        """See :class:`.protocol.Program`."""
        return self.program.seconds

    def seconds_of(self, count: int) -> float:
        """See :meth:`.protocol.Program.seconds_of`."""
        return self.program.seconds_of(count)

    @property
    def sha256(self) -> str:
        """See :class:`.protocol.Program`."""
        return self.program.sha256

    @property
    def failure(self) -> str | None:
        """See :class:`.protocol.Program`."""
        return self.program.failure

    def forget_failures(self) -> None:
        """See :meth:`dashred.physics.external.protocol.Program.forget_failures`."""
        self.program.forget_failures()

    def step(
        self,
        states: Array,
        t: Array,
        dt: Array,
        inputs: Mapping[str, Array],
        parameters: Mapping[str, float],
    ) -> Array:
        """See :meth:`.protocol.Program.step`."""
        own = _PartialStepper(self.program, self.places)
        return own.step(states, t, dt, inputs, parameters)


@dataclass(frozen=True)
class _PartialStepper:
    """Steps some channels of a state, and leaves the others as they are."""

    stepper: Stepper
    places: Sequence[int]

    def step(
        self,
        states: Array,
        t: Array,
        dt: Array,
        inputs: Mapping[str, Array],
        parameters: Mapping[str, float],
    ) -> Array:
        after, own = states.copy(), list(self.places)
        after[:, own] = self.stepper.step(states[:, own], t, dt, inputs, parameters)
        return after
