"""One system compiled for many runs, whatever kind it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, Self

import torch
from torch import Tensor

from dashred.physics.expressions.algebra import multiply
from dashred.physics.expressions.semilinear import NotSemilinearError
from dashred.physics.forcing_basis import SampledForcing
from dashred.physics.solvers.batch_coefficients import CoefficientLayout
from dashred.physics.solvers.compiled_etdrk4 import CompiledETDRK4
from dashred.physics.solvers.compiled_runge_kutta import CompiledRungeKutta
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.simulate import simulate, worth_compiling
from dashred.physics.system import System, Term
from dashred.physics.window import Shape


class CompiledSystem(Protocol):
    """Many runs of one system with terms of which each trajectory carries its own share."""

    def __call__(
        self,
        start: Tensor,
        times: Tensor,
        weights: Tensor,
        sampled_forcing: SampledForcing | None = None,
    ) -> Tensor:
        """Return ``(batch, time, field, *grid)`` for the weights and forcing of each trajectory.

        Weights ``(batch, term)``; with windows, as
        :class:`dashred.physics.solvers.batch_coefficients.CoefficientLayout` has them.
        """

    def with_step(self, dt: float) -> Self:
        """Return the same with another time step."""


@dataclass(frozen=True)
class InterpretedSystem:
    """What cannot be compiled goes through :func:`simulate` itself."""

    system: System
    terms: tuple[Term, ...]
    shapes: tuple[Shape, ...] = ()

    def __call__(
        self,
        start: Tensor,
        times: Tensor,
        weights: Tensor,
        sampled_forcing: SampledForcing | None = None,
    ) -> Tensor:
        """Return ``(batch, time, field, *grid)`` for the weights and forcing of each trajectory."""
        columns = CoefficientLayout(len(self.terms), self.shapes)
        if not self.shapes:
            forcing = Forcing(self.terms, weights)
            return simulate(self.system, start, times, forcing, sampled_forcing=sampled_forcing)
        alone = [
            self._one(
                start[i : i + 1], times, columns, row, sampled_forcing and sampled_forcing.row(i)
            )
            for i, row in enumerate(weights)
        ]
        return torch.cat(alone)

    def _one(
        self,
        start: Tensor,
        times: Tensor,
        columns: CoefficientLayout,
        weights: Tensor,
        sampled_forcing: SampledForcing | None,
    ) -> Tensor:
        window = columns.window(weights)
        inside = [Term(t.equation, multiply((t.expression, window))) for t in self.terms]
        forcing = Forcing((*self.terms, *inside), weights[None, : 2 * columns.terms])
        return simulate(self.system, start, times, forcing, sampled_forcing=sampled_forcing)

    def with_step(self, dt: float) -> InterpretedSystem:
        """Return the same with another time step."""
        return replace(self, system=self.system.with_step(dt))


def compile_system(
    system: System, terms: Sequence[Term], shapes: tuple[Shape, ...] = ()
) -> CompiledSystem:
    """Return the system compiled: spectral systems, and ODE systems with fixed steps, on the CPU.

    Args:
        system: the simulator.
        terms: whatever a trajectory may carry, lets and parameters resolved.
        shapes: of the windows in which it may carry them.
    """
    if not system.axes and system.tableau is not None:
        return CompiledRungeKutta(system, terms, shapes)
    if system.spectral:
        try:
            return CompiledETDRK4(system, terms, shapes)
        except (NotSemilinearError, ArithmeticError):
            pass
    return InterpretedSystem(system, tuple(terms), shapes)


def compile_if_worthwhile(
    system: System, terms: Sequence[Term], start: Tensor, span: float
) -> CompiledSystem:
    """Return the system compiled where running it so long pays for that, else interpreted.

    Args:
        system: the simulator.
        terms: whatever a trajectory may carry, lets and parameters resolved.
        start: ``(batch, field, *grid)``.
        span: time that is run through, all runs together.
    """
    pays = worth_compiling(system, start, span, len(terms))
    return compile_system(system, terms) if pays else InterpretedSystem(system, tuple(terms))
