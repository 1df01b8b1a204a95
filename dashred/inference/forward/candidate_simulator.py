"""One simulator with candidate terms: trajectories and their derivatives.

It integrates ``∂u/∂t = N(u) + Σ_j ξ_j θ_j(u) + χ(ψ) Σ_j η_j θ_j(u) + f(x, t)``: the system's own
tendency N, candidate terms θ, candidate terms within a window χ, and a forcing f. The coefficients
of a trajectory are a row of weights, so that one compiled program serves every fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property, partial

import torch
from torch import Tensor

from dashred.core.work import count_columns, count_trajectories
from dashred.inference.forward.candidates import Candidate, build_forcing
from dashred.physics.cells.compiled import CompiledCells
from dashred.physics.forcing_basis import ForcingBasis, SampledForcing
from dashred.physics.solvers.batch_coefficients import CoefficientLayout
from dashred.physics.solvers.compiled.etdrk4 import CompiledETDRK4
from dashred.physics.solvers.compiled_simulator import CompiledSystem, compile_system
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.schedule import count_steps
from dashred.physics.system import CPU, System, Term
from dashred.physics.tangents.cell_tangents import has_cell_tangents, tangent_cells
from dashred.physics.tangents.compiled_trajectory import CompiledTrajectory
from dashred.physics.tangents.ode_tangents import has_ode_tangents, tangent_ode
from dashred.physics.tangents.on_device.spectral_tangents import tangents_on_device
from dashred.physics.tangents.program_tangents import tangent_program
from dashred.physics.tangents.tangent_linear import has_spectral_tangents, tangent_linear
from dashred.physics.window import Shape, Window


class CandidateSimulator:
    """A system with candidate terms; the first run compiles it.

    A simulator that is only linearised is never compiled.

    Attributes:
        system: the system.
        tangent: the same system with the time step of the derivative.
        shapes: shapes of the windows in which candidates may act.
        has_tangents: whether tangent-linear equations exist for it.

    Args:
        system: the simulator.
        tangent_dt: largest time step of the derivative. An error of a percent in the derivative is
            harmless, because the residuals always come from the system itself.
        candidates: all candidates.
        shapes: shapes of the windows in which they may act.
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
        self.terms = build_forcing(candidates, torch.zeros((1, len(candidates)))).terms
        self._columns: dict[str, list[int]] = {}
        first = 0
        for candidate in candidates:
            self._columns[candidate.key] = [*range(first, first + len(candidate.effects))]
            first += len(candidate.effects)
        self._layout = CoefficientLayout(len(self.terms), shapes)
        self.has_tangents = system.program is not None or any(
            supports(system, self.terms)
            for supports in (has_spectral_tangents, has_ode_tangents, has_cell_tangents)
        )

    @cached_property
    def _run(self) -> CompiledSystem:
        return compile_system(self.system, self.terms, self.shapes)

    def __getstate__(self) -> dict[str, object]:
        """Return what a worker of a cluster needs: it compiles the system itself."""
        return {name: value for name, value in vars(self).items() if name != "_run"}

    @property
    def compiled(self) -> CompiledETDRK4 | CompiledCells | None:
        """The compiled simulator of fields; None before the first run, and for other systems."""
        compiled = vars(self).get("_run")
        return compiled if isinstance(compiled, CompiledETDRK4 | CompiledCells) else None

    def has_compiled(self, candidates: Sequence[Candidate]) -> bool:
        """Return whether compiled code integrates trajectories with these candidates.

        A simulator that is only linearised is not compiled for that. A candidate within a window
        has the same key as the candidate everywhere, but other terms.
        """
        return self.compiled is not None and all(
            [self.terms[place] for place in self._columns.get(candidate.key, ())]
            == list(candidate.terms)
            for candidate in candidates
        )

    def coarse(self) -> CandidateSimulator:
        """Return the simulator with the time step of the derivative for its trajectories, too."""
        other = self._copy()
        other.system = self.tangent
        other._run = self._run.with_step(self.tangent.dt)
        return other

    def finer(self) -> CandidateSimulator:
        """Return the simulator with the time step of the system for its derivative, too."""
        other = self._copy()
        other.tangent = self.system
        return other

    def _copy(self) -> CandidateSimulator:
        """Return a copy with what is compiled."""
        other = CandidateSimulator.__new__(CandidateSimulator)
        vars(other).update(vars(self))
        return other

    def with_candidates(self, candidates: Sequence[Candidate]) -> CandidateSimulator:
        """Return the simulator with other candidates, without windows."""
        return CandidateSimulator(self.system, self.tangent.dt, candidates)

    def weights(
        self,
        candidates: Sequence[Candidate],
        xi: Tensor,
        windowed: Tensor | None = None,
        windows: Sequence[Window] = (),
    ) -> Tensor:
        """Return the weights of trajectories, ``(row, weight)``.

        Args:
            candidates: some of the simulator's candidates.
            xi: their coefficients, ``(row, candidate)``.
            windowed: their additional coefficients within the window of each row,
                ``(row, candidate)``; None without windows.
            windows: the window of each row.
        """
        if windowed is not None:
            by_term = self._by_term(candidates, xi), self._by_term(candidates, windowed)
            return self._layout.weights(*by_term, windows)
        weights = torch.zeros((len(xi), self._layout.count), dtype=torch.float64)
        weights[:, : len(self.terms)] = self._by_term(candidates, xi)
        return weights

    def run(
        self, start: Tensor, times: Tensor, weights: Tensor, forcing: SampledForcing | None = None
    ) -> Tensor:
        """Return trajectories ``(row, time, field, *grid)``.

        Args:
            start: states at the first time, ``(row, field, *grid)``.
            times: ``(time,)``.
            weights: weights of each row, from :meth:`weights`.
            forcing: forcing of each row; None without one.
        """
        steps = count_steps(times.tolist(), self.system.dt)
        count_trajectories(len(start), steps, start[0].numel())
        return self._run(start, times, weights, forcing)

    def tangents(
        self,
        start: Tensor,
        directions: Tensor,
        times: Tensor,
        forcing: Forcing,
        sources: Sequence[tuple[Term, ...]],
        sampled_forcing: SampledForcing | None,
        forcing_basis: ForcingBasis | None,
        weights: Tensor | None,
        chosen: range | None = None,
    ) -> Iterator[tuple[Tensor, Tensor]]:
        """Yield the state and its derivatives at every time.

        The columns are the directions of the start, the sources and the amplitudes of the forcing.
        See :meth:`.simulator.Simulator.tangents`.

        Args:
            start: ``(field, *grid)``.
            directions: derivatives of the start, ``(direction, field, *grid)``.
            times: ``(time,)``.
            forcing: the law, one row.
            sources: terms; a column is the derivative by the coefficient of one entry.
            sampled_forcing: the free forcing, one row; None without one.
            forcing_basis: basis of the free forcing.
            weights: weights of the law, for a trajectory of compiled code; None for one that is
                not compiled.
            chosen: the columns that are wanted; None, or all of them, without :attr:`has_chunks`.
        """
        columns = len(directions) + len(sources) + (forcing_basis.count if forcing_basis else 0)
        columns = columns if chosen is None else len(chosen)
        count_columns(columns, count_steps(times.tolist(), self.tangent.dt), start.numel())
        base = self.tangent, start, directions, times, forcing, sources
        if self.system.program is not None:
            return tangent_program(*base, sampled_forcing, forcing_basis)
        if not self.system.axes:
            return tangent_ode(*base, sampled_forcing, forcing_basis)
        compiled = None if weights is None else self._run
        if self.system.has_conditions:
            stages = None
            if isinstance(compiled, CompiledCells) and weights is not None:
                stages = partial(compiled.stages, weights, sampled_forcing)
            return tangent_cells(*base, sampled_forcing, forcing_basis, stages)
        if self.system.device != CPU:
            return tangents_on_device(*base, torch.float32, sampled_forcing, forcing_basis)
        reference = None
        if isinstance(compiled, CompiledETDRK4) and weights is not None:
            own = compiled.with_step(self.tangent.dt)
            reference = CompiledTrajectory(own, weights, sampled_forcing)
        return tangent_linear(
            *base, torch.float32, sampled_forcing, forcing_basis, reference, chosen
        )

    @property
    def has_chunks(self) -> bool:
        """Whether columns are integrated in chunks, so that some can be had without the others."""
        is_plain = self.system.program is None and self.system.device == CPU
        return self.has_tangents and self.system.spectral and is_plain

    def _by_term(self, candidates: Sequence[Candidate], xi: Tensor) -> Tensor:
        weights = torch.zeros((len(xi), len(self.terms)), dtype=torch.float64)
        for j, candidate in enumerate(candidates):
            weights[:, self._columns[candidate.key]] += xi[:, j, None]
        return weights
