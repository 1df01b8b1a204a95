"""One system compiled for many runs, whatever kind it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, Self

from torch import Tensor

from dashred.physics.compiled_march import CompiledMarch
from dashred.physics.compiled_ode import CompiledOde
from dashred.physics.forcing import Forcing
from dashred.physics.linearisation import NotSeparableError
from dashred.physics.simulate import simulate
from dashred.physics.system import System, Term


class Run(Protocol):
    """Many runs of one system with terms of which each trajectory carries its own share."""

    def __call__(self, start: Tensor, times: Tensor, weights: Tensor) -> Tensor:
        """Return ``(batch, time, field, *grid)`` for weights ``(batch, term)``."""

    def with_step(self, dt: float) -> Self:
        """Return the same with another time step."""


@dataclass(frozen=True)
class Interpreted:
    """What cannot be compiled goes through :func:`simulate` itself."""

    system: System
    terms: tuple[Term, ...]

    def __call__(self, start: Tensor, times: Tensor, weights: Tensor) -> Tensor:
        """Return ``(batch, time, field, *grid)`` for weights ``(batch, term)``."""
        return simulate(self.system, start, times, Forcing(self.terms, weights))

    def with_step(self, dt: float) -> Interpreted:
        """Return the same with another time step."""
        return replace(self, system=self.system.with_step(dt))


def compiled(system: System, terms: Sequence[Term]) -> Run:
    """Return the system compiled: spectral systems and ODE systems by ``rk4``, on the CPU.

    Args:
        system: the simulator.
        terms: whatever a trajectory may carry, lets and parameters resolved.
    """
    if not system.axes and system.method == "rk4":
        return CompiledOde(system, terms)
    if system.spectral:
        try:
            return CompiledMarch(system, terms)
        except (NotSeparableError, ArithmeticError):
            pass
    return Interpreted(system, tuple(terms))
