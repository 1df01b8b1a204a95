"""The simulator with any law of its candidates: trajectories, and their derivatives."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from functools import cached_property

import torch
from torch import Tensor

from dashred.inference.forward.candidates import Candidate, forcing_of
from dashred.physics.forcing_basis import ForcingBasis, SampledForcing
from dashred.physics.solvers.batch_coefficients import Columns
from dashred.physics.solvers.compiled_simulator import CompiledSystem, compiled
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.system import System, Term
from dashred.physics.tangents.ode_tangents import supports_ode, tangent_ode
from dashred.physics.tangents.tangent_linear import supports, tangent_linear
from dashred.physics.window import Shape, Window


class Simulator:
    """The simulator with every candidate in reach, compiled once for all fits, by the first run.

    What is only linearised need not be compiled.

    Attributes:
        system: the simulator.
        tangent: the same with the step that its derivative is good enough with.
        shapes: of the windows in which candidates may be added.

    Args:
        system: the simulator.
        tangent_dt: longest step of the derivative; a percent of error in it costs nothing, for
            residuals are always those of the system itself.
        candidates: whatever may be added to it.
        shapes: of the windows in which it may be added.
    """

    def __init__(
        self,
        system: System,
        tangent_dt: float,
        candidates: Sequence[Candidate],
        shapes: tuple[Shape, ...] = (),
    ) -> None:
        self.system, self.shapes = system, shapes
        self.tangent = system.with_step(max(tangent_dt, system.dt))
        self.terms = forcing_of(candidates, torch.zeros((1, len(candidates)))).terms
        self._columns: dict[str, list[int]] = {}
        first = 0
        for candidate in candidates:
            self._columns[candidate.key] = [*range(first, first + len(candidate.terms))]
            first += len(candidate.terms)
        self._layout = Columns(len(self.terms), shapes)
        self.has_tangents = supports(system, self.terms) or supports_ode(system, self.terms)

    @cached_property
    def _run(self) -> CompiledSystem:
        return compiled(self.system, self.terms, self.shapes)

    def coarse(self) -> Simulator:
        """Return the simulator that takes the derivative's steps itself."""
        other = copy.copy(self)
        other.system = self.tangent
        other._run = self._run.with_step(self.tangent.dt)
        return other

    def finer(self) -> Simulator:
        """Return the simulator whose derivative takes its own steps."""
        other = copy.copy(self)
        other.tangent = self.system
        return other

    def of(self, candidates: Sequence[Candidate]) -> Simulator:
        """Return the same system with other candidates in reach, everywhere."""
        return Simulator(self.system, self.tangent.dt, candidates)

    def run(
        self,
        start: Tensor,
        times: Tensor,
        candidates: Sequence[Candidate],
        xi: Tensor,
        sampled_forcing: SampledForcing | None = None,
    ) -> Tensor:
        """Return trajectories ``(batch, time, field, *grid)`` with coefficients of some."""
        weights = torch.zeros((len(start), self._layout.count), dtype=torch.float64)
        weights[:, : len(self.terms)] = self._by_term(candidates, xi)
        return self._run(start, times, weights, sampled_forcing)

    def run_local(
        self,
        start: Tensor,
        times: Tensor,
        candidates: Sequence[Candidate],
        everywhere: Tensor,
        inside: Tensor,
        windows: Sequence[Window],
        sampled_forcing: SampledForcing | None = None,
    ) -> Tensor:
        """Return trajectories in which candidates act within each row's window, too.

        Args:
            start: ``(batch, field, *grid)``.
            times: ``(time,)``.
            candidates: some of them.
            everywhere: their coefficients, ``(batch, candidate)``.
            inside: what is added to these within the window.
            windows: of each row.
            sampled_forcing: a free forcing of each row.
        """
        plain = self._by_term(candidates, everywhere)
        local = self._by_term(candidates, inside)
        weights = self._layout.weights(plain, local, windows)
        return self._run(start, times, weights, sampled_forcing)

    def tangents(
        self,
        start: Tensor,
        directions: Tensor,
        times: Tensor,
        forcing: Forcing,
        sources: Sequence[tuple[Term, ...]],
        sampled_forcing: SampledForcing | None,
        forcing_basis: ForcingBasis | None,
    ) -> Iterator[tuple[Tensor, Tensor]]:
        """Yield state and tangents at every sample: of the directions, the sources, the pulses."""
        base = self.tangent, start, directions, times, forcing, sources
        if self.system.axes:
            return tangent_linear(*base, torch.float32, sampled_forcing, forcing_basis)
        return tangent_ode(*base, sampled_forcing, forcing_basis)

    def visited(self, states: Tensor, times: Tensor) -> Tensor:
        """Return all states ``(sample, field, *grid)`` of a trajectory on its clock."""
        return states

    def _by_term(self, candidates: Sequence[Candidate], xi: Tensor) -> Tensor:
        weights = torch.zeros((len(xi), len(self.terms)), dtype=torch.float64)
        for j, candidate in enumerate(candidates):
            weights[:, self._columns[candidate.key]] += xi[:, j, None]
        return weights
