"""A simulator that is a program: a function, an FMU or a command that steps states.

Its equations are not known. A law acts beside it by operator splitting
(:mod:`dashred.physics.solvers.splitting`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.physics.external.function import FunctionProgram, run_as_step
from dashred.physics.external.trust import check_trusted
from dashred.physics.external.user_code import last_words, load
from dashred.physics.system_schema import System

Array = NDArray[np.float64]


class Program(Protocol):
    """A program that advances states.

    The first call of :meth:`step` examines it; ``rounding`` and ``seconds`` are known after that.
    """

    @property
    def rounding(self) -> float:
        """Relative rounding error of its results, such as 1e-16 or 6e-8."""

    @property
    def seconds(self) -> float:
        """Duration of one call with one state."""

    @property
    def failure(self) -> str | None:
        """What it said when it last failed: an exception with its place, or lines of stderr."""

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


def open_program(config: System, where: Callable[[str], str]) -> Program:
    """Return the program of a system; a process opens each program once.

    Args:
        config: of the system, with ``simulator``.
        where: location of a configuration key.

    Raises:
        InputError: the program is not trusted, or cannot be opened.
    """
    simulator = config.simulator
    assert simulator is not None
    key = "function" if simulator.function is not None else "run"
    name = simulator.function or simulator.run
    assert name is not None
    place = where(f"system.simulator.{key}")
    check_trusted(name, place)
    return _open_function(name, key == "run", tuple(config.fields), place)


@lru_cache
def _open_function(name: str, runs: bool, fields: tuple[str, ...], place: str) -> Program:
    try:
        function = load(name)
    except Exception as error:  # user code may raise any exception
        hint = "its module must be in the current folder, or installed"
        what = f"{name} cannot be imported: {last_words(error)}"
        raise InputError(what, where=place, hint=hint) from error
    if not callable(function):
        raise InputError(f"{name} is not a function", where=place)
    step = run_as_step(function, fields) if runs else function
    return FunctionProgram(step, fields, name, place)
