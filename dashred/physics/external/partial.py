"""A program that steps some of the fields."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dashred.physics.external.protocol import Array, Program


@dataclass(frozen=True)
class PartialProgram:
    """A program beside fields that it does not know: it leaves them as they are.

    Attributes:
        program: steps its own fields.
        places: indices of these in the state.
    """

    program: Program
    places: Sequence[int]

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

    def step(
        self,
        states: Array,
        t: Array,
        dt: Array,
        inputs: Mapping[str, Array],
        parameters: Mapping[str, float],
    ) -> Array:
        """See :meth:`.protocol.Program.step`."""
        after, own = states.copy(), list(self.places)
        after[:, own] = self.program.step(states[:, own], t, dt, inputs, parameters)
        return after
