"""A simulator that is a program: a function, an FMU or a command that steps states.

Its equations are not known. A law acts beside it by operator splitting
(:mod:`dashred.physics.solvers.splitting`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dashred.physics.external.adapter import Adapter
from dashred.physics.external.command.command import open_command
from dashred.physics.external.command.layout import Layout
from dashred.physics.external.fmu.fmu import open_fmu
from dashred.physics.external.function import open_function, open_run
from dashred.physics.external.stepped import SteppedProgram
from dashred.physics.external.trust import check_trusted, names_of
from dashred.physics.grids.grid import Grid
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
    def sha256(self) -> str:
        """Hash of the contents of its own files."""

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


_opened: dict[tuple[object, ...], Program] = {}


def open_program(config: System, where: Callable[[str], str], grid: Grid) -> Program:
    """Return the program of a system; a process opens each program once.

    Args:
        config: of the system, with ``simulator``.
        where: location of a configuration key.
        grid: of the system.

    Raises:
        InputError: the program is not trusted, or cannot be opened.
    """
    simulator = config.simulator
    assert simulator is not None
    [(key, name)] = names_of(simulator).items()
    place = where(f"system.simulator.{key}")
    check_trusted(name, place)
    known = repr(simulator), tuple(config.fields), repr(config.units), grid, place
    if known not in _opened:
        _opened[known] = SteppedProgram(_adapter(config, key, grid, place), grid, simulator.keep)
    return _opened[known]


def _adapter(config: System, key: str, grid: Grid, place: str) -> Adapter:
    simulator, fields = config.simulator, tuple(config.fields)
    assert simulator is not None
    if simulator.command is not None:
        axes = {
            axis.name: axis.spacing * np.arange(axis.own_points, dtype=np.float64)
            for axis in grid.axes
        }
        layout = Layout(fields, axes, config.units)
        limit = simulator.time_limit
        return open_command(simulator.command, simulator.template, limit, layout, place)
    if simulator.fmu is not None:
        others, interface = _names_of_fmu(config), simulator.interface
        return open_fmu(simulator.fmu, fields, others, simulator.variables, interface, place)
    if simulator.function is not None:
        return open_function(simulator.function, fields, place)
    assert simulator.run is not None
    return open_run(simulator.run, fields, place)


def _names_of_fmu(config: System) -> list[str]:
    """Return the parameters and inputs that an FMU must have: all but those of the law alone."""
    texts = " ".join(repr(part) for part in (config.equations, config.let, config.energy))
    own = set(re.findall(r"[A-Za-z]\w*", texts))
    simulator = config.simulator
    named = set() if simulator is None else set(simulator.variables)
    return [n for n in (*config.parameters, *config.inputs) if n in named or n not in own]
