"""Compile a system for many runs."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, Self

import torch
from torch import Tensor

from dashred.physics.cells.compiled import CompiledCells
from dashred.physics.expressions.algebra import multiply
from dashred.physics.expressions.semilinear import NotSemilinearError
from dashred.physics.forcing_basis import SampledForcing
from dashred.physics.solvers.batch_coefficients import CoefficientLayout
from dashred.physics.solvers.compiled.etdrk4 import CompiledETDRK4
from dashred.physics.solvers.compiled.runge_kutta import CompiledRungeKutta
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.schedule import schedule
from dashred.physics.solvers.simulate import is_compilation_worthwhile, simulate
from dashred.physics.system import CPU, System, Term
from dashred.physics.window import Shape


class CompiledSystem(Protocol):
    """A system for many runs, in which each trajectory has its own coefficients of the terms."""

    def __call__(
        self,
        start: Tensor,
        times: Tensor,
        weights: Tensor,
        sampled_forcing: SampledForcing | None = None,
    ) -> Tensor:
        """Return trajectories ``(batch, time, field, *grid)``.

        Args:
            start: ``(batch, field, *grid)`` at ``times[0]``.
            times: output times, ``(time,)``.
            weights: coefficients of the terms, ``(batch, column)``, in the order of
                :class:`dashred.physics.solvers.batch_coefficients.CoefficientLayout`.
            sampled_forcing: free forcing of each trajectory.
        """

    def with_step(self, dt: float) -> Self:
        """Return a copy with another time step."""


@dataclass(frozen=True)
class InterpretedSystem:
    """A system that is run by :func:`simulate` without compilation."""

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
        """See :meth:`CompiledSystem.__call__`."""
        layout = CoefficientLayout(len(self.terms), self.shapes)
        if not self.shapes:
            forcing = Forcing(self.terms, weights)
            return simulate(self.system, start, times, forcing, sampled_forcing=sampled_forcing)
        trajectories = [
            self._run_one(
                start[i : i + 1], times, layout, row, sampled_forcing and sampled_forcing.row(i)
            )
            for i, row in enumerate(weights)
        ]
        return torch.cat(trajectories)

    def _run_one(
        self,
        start: Tensor,
        times: Tensor,
        layout: CoefficientLayout,
        weights: Tensor,
        sampled_forcing: SampledForcing | None,
    ) -> Tensor:
        window = layout.window(weights)
        inside = [Term(t.equation, multiply((t.expression, window))) for t in self.terms]
        forcing = Forcing((*self.terms, *inside), weights[None, : 2 * layout.terms])
        return simulate(self.system, start, times, forcing, sampled_forcing=sampled_forcing)

    def with_step(self, dt: float) -> InterpretedSystem:
        """Return a copy with another time step."""
        return replace(self, system=self.system.with_step(dt))


@dataclass(frozen=True)
class DeviceSystem:
    """A spectral system on another device than the CPU.

    A batch is integrated there by :func:`simulate`. Only trajectories with a window, which differs
    from one to the next, are integrated by compiled code on the CPU.
    """

    system: System
    terms: tuple[Term, ...]
    shapes: tuple[Shape, ...] = ()

    @cached_property
    def _windowed(self) -> CompiledSystem:
        return compile_system(self.system.on(CPU), self.terms, self.shapes)

    def __call__(
        self,
        start: Tensor,
        times: Tensor,
        weights: Tensor,
        sampled_forcing: SampledForcing | None = None,
    ) -> Tensor:
        """See :meth:`CompiledSystem.__call__`."""
        has_window = (weights[:, len(self.terms) :] != 0).any(dim=1)
        states = start.new_empty((len(start), len(times), *start.shape[1:]))
        plain = InterpretedSystem(self.system, self.terms)
        parts: list[tuple[Tensor, CompiledSystem, Tensor]] = []
        if not has_window.all():
            parts.append((~has_window, plain, weights[:, : len(self.terms)]))
        if has_window.any():
            parts.append((has_window, self._windowed, weights))
        for rows, run, own in parts:
            force = sampled_forcing and sampled_forcing.rows(rows)
            states[rows] = run(start[rows], times, own[rows], force)
        return states

    def with_step(self, dt: float) -> DeviceSystem:
        """Return a copy with another time step."""
        return replace(self, system=self.system.with_step(dt))


def compile_system(
    system: System, terms: Sequence[Term], shapes: tuple[Shape, ...] = ()
) -> CompiledSystem:
    """Compile a system: spectral, finite volumes, or an ODE system with fixed steps, on the CPU.

    A spectral system on another device is returned as :class:`DeviceSystem`, and all other systems
    as :class:`InterpretedSystem`.

    Args:
        system: the simulator.
        terms: all terms that a trajectory may have, with lets and parameters resolved.
        shapes: the possible factors of the windows of these terms.
    """
    if system.program is not None:
        return InterpretedSystem(system, tuple(terms), shapes)
    if system.device != CPU:
        return DeviceSystem(system, tuple(terms), shapes)
    if not system.axes and system.tableau is not None:
        return CompiledRungeKutta(system, terms, shapes)
    with suppress(NotSemilinearError, ArithmeticError):
        if system.spectral:
            return CompiledETDRK4(system, terms, shapes)
        if system.has_conditions:
            layout = CoefficientLayout(len(terms), shapes)
            return CompiledCells(system, terms, layout, schedule)
    return InterpretedSystem(system, tuple(terms), shapes)


def compile_if_worthwhile(
    system: System, terms: Sequence[Term], start: Tensor, span: float
) -> CompiledSystem:
    """Compile a system if the runs are long enough to save the compilation time.

    Args:
        system: the simulator.
        terms: all terms that a trajectory may have, with lets and parameters resolved.
        start: initial states ``(batch, field, *grid)``.
        span: simulated time of all runs together.
    """
    if is_compilation_worthwhile(system, start, span, len(terms)):
        return compile_system(system, terms)
    return InterpretedSystem(system, tuple(terms))
