"""Run the members of a filter from sample to sample."""

from __future__ import annotations

import copy
from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray

from dashred.inference.observer.live_inputs import LiveInputs
from dashred.physics.solvers.compiled.etdrk4 import CompiledETDRK4
from dashred.physics.solvers.compiled.runge_kutta import CompiledRungeKutta
from dashred.physics.solvers.compiled_simulator import CompiledSystem, compile_system
from dashred.physics.system import System

Array = NDArray[np.float64]

# Number of spans whose steps are kept; a stream on a clock has two, to a sample and ahead.
KEPT = 8


class March:
    """The flow of a simulator over any span, with little work besides its steps.

    Attributes:
        system: the simulator.

    Args:
        system: the simulator, with fixed steps where it has no axes.
        inputs: that drive this simulator while they come in.
    """

    def __init__(self, system: System, inputs: LiveInputs | None = None) -> None:
        self.system, self._inputs = system, inputs
        self._compiled: CompiledSystem = compile_system(system, ())
        self._points = points_of(system)
        self._depends_on_time, self._has_jumps = system.reads_time(), len(system.jumps) > 0
        self._leaps: dict[tuple[int, float], Callable[[Array, float], Array]] = {}

    @property
    def has_inputs(self) -> bool:
        """Whether inputs that come in drive the simulator."""
        return self._inputs is not None

    @property
    def begin(self) -> float:
        """A time from which simulations may run; with inputs, that of the first sample."""
        return 0.0 if self._inputs is None else self._inputs.first

    @property
    def takes_other_steps(self) -> bool:
        """Whether :meth:`with_step` is possible: for spectral flows without jumps."""
        return isinstance(self._compiled, CompiledETDRK4) and not self._has_jumps

    def with_step(self, step: float) -> March:
        """Return the same flow with another time step, without recompilation."""
        assert isinstance(self._compiled, CompiledETDRK4)
        other = copy.copy(self)
        other._compiled, other._leaps = self._compiled.with_step(step), {}
        other.system = other._compiled.system
        return other

    def __call__(
        self, states: Array, begin: float, span: float, known: float | None = None
    ) -> Array:
        """Return states ``(state, field*point)`` after a span that begins at a time.

        Args:
            states: at that time.
            begin: the time.
            span: the time span.
            known: time until which inputs are known; None for the end of the span.
        """
        if self._inputs is not None:
            self._inputs.show(begin, begin + span if known is None else known)
        if isinstance(self._compiled, CompiledRungeKutta):
            return self._leap(self._compiled, len(states), span)(states, begin)
        first = begin if self._depends_on_time else 0.0
        if isinstance(self._compiled, CompiledETDRK4) and self.takes_other_steps:
            start = self.on_grid(states).numpy()
            end = self._leap(self._compiled, len(states), span)(start, first)
            return self.off_grid(torch.from_numpy(end.reshape(start.shape)))
        # The coefficients of the steps are kept for equal steps, and rounding would change these.
        times = torch.tensor([first, first + span], dtype=torch.float64)
        weights = torch.zeros((len(states), 0), dtype=torch.float64)
        path = self._compiled(self.on_grid(states), times, weights)[:, -1]
        return self.off_grid(path)

    def _leap(
        self, compiled: CompiledRungeKutta | CompiledETDRK4, count: int, span: float
    ) -> Callable[[Array, float], Array]:
        """Return the flow of so many states over a span; it is prepared once."""
        key = count, span
        if key not in self._leaps:
            if len(self._leaps) >= KEPT:
                del self._leaps[next(iter(self._leaps))]
            none = torch.zeros((count, 0), dtype=torch.float64)
            self._leaps[key] = compiled.leap(none, span)
        return self._leaps[key]

    def off_grid(self, states: torch.Tensor) -> Array:
        """Return states ``(state, field, *grid)`` without images, ``(state, field*point)``."""
        return self.system.grid.own(states).reshape(len(states), -1).numpy()

    def on_grid(self, states: Array) -> torch.Tensor:
        """Return states with the mirror images of the grid, ``(state, field, *grid)``."""
        shape = (len(states), len(self.system.fields), *self._points)
        return self.system.grid.ring(torch.from_numpy(states).reshape(shape))


def points_of(system: System) -> tuple[int, ...]:
    """Return the number of points along each axis, without mirror images."""
    return tuple(system.grid.own(torch.zeros(system.grid.shape)).shape)
