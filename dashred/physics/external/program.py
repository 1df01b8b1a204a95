"""A simulator that is a program: a function, an FMU or a command that steps states.

Its equations are not known. A law acts beside it by operator splitting
(:mod:`dashred.physics.solvers.splitting`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dashred.physics.system_schema import System

Array = NDArray[np.float64]


class Program(Protocol):
    """A program that advances states.

    Attributes:
        rounding: relative rounding error of its results, such as 1e-16 or 1e-7.
    """

    rounding: float

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
        """


def open_program(config: System, where: Callable[[str], str]) -> Program:
    """Return the program of a system; a process opens each program once.

    Args:
        config: of the system, with ``simulator``.
        where: location of a configuration key.

    Raises:
        InputError: the program is not trusted, cannot be opened, or does not keep to the protocol.
    """
    assert config.simulator is not None and config.simulator.function is not None
    return _open_function(config.simulator.function, tuple(config.fields))


@lru_cache
def _open_function(name: str, fields: tuple[str, ...]) -> Program:
    module, _, attribute = name.rpartition(".")
    return FunctionProgram(getattr(import_module(module), attribute), fields)


@dataclass(frozen=True)
class FunctionProgram:
    """A Python function that steps a batch of states."""

    function: Callable[..., Mapping[str, Any]]
    fields: tuple[str, ...]
    rounding: float = 1e-15

    def step(
        self,
        states: Array,
        t: Array,
        dt: Array,
        inputs: Mapping[str, Array],
        parameters: Mapping[str, float],
    ) -> Array:
        """See :meth:`Program.step`."""
        state = dict(zip(self.fields, np.moveaxis(states, 1, 0).copy(), strict=True))
        found = self.function(state, t, dt, inputs, parameters)
        return np.stack([np.asarray(found[f], dtype=np.float64) for f in self.fields], axis=1)
