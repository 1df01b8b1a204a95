"""The protocol of a simulator that is a program: a function, an FMU or a command.

Its equations are not known. A law acts beside it by operator splitting
(:mod:`dashred.physics.solvers.splitting`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Stepper(Protocol):
    """What steps states."""

    def step(
        self,
        states: Array,
        t: Array,
        dt: Array,
        inputs: Mapping[str, Array],
        parameters: Mapping[str, float],
    ) -> Array:
        """Return the states after a step, ``(batch, field, *grid)``; NaN where it fails.

        Args:
            states: ``(batch, field, *grid)``, in the order of the system's fields; not changed.
            t: time of each state, ``(batch,)``.
            dt: length of the step from each, ``(batch,)``.
            inputs: values in the middle of the step by name, ``(batch,)`` each.
            parameters: values by name.

        Raises:
            InputError: in the first call, if the program does not keep to the protocol.
        """


class Program(Stepper, Protocol):
    """A program that advances states.

    The first call of :meth:`step` examines it. Until then ``seconds`` is 0, and ``rounding`` is
    that of single precision.
    """

    @property
    def rounding(self) -> float:
        """Relative rounding error of its results, such as 1e-16 or 6e-8."""

    @property
    def seconds(self) -> float:
        """Duration of one call with one state."""

    def seconds_of(self, count: int) -> float:
        """Return the duration of one step of so many states."""

    @property
    def sha256(self) -> str:
        """Hash of the contents of its own files."""

    @property
    def tangent(self) -> Stepper | None:
        """Steps states with tangents, ``(batch, 2 field, *grid)``; None if it offers none."""

    @property
    def failure(self) -> str | None:
        """How many of its steps failed, and what it said in the last of these; None if none did.

        It is an exception with its place, lines of stderr, or that its values are not finite.
        """

    def forget_failures(self) -> None:
        """Begin to count the failures of another analysis in the same process."""
