"""Shooting: from a start and a model error, through the simulator, to what the sensors read."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.discovery.candidates import Candidate, forcing_of
from dashred.discovery.starts import StartModel
from dashred.physics.forcing import Forcing
from dashred.physics.ode_tangents import supports_ode, tangent_ode
from dashred.physics.pulses import Drive, Pulses
from dashred.physics.simulator import Run, compiled
from dashred.physics.system import System, Term
from dashred.physics.tangent_linear import supports, tangent_linear
from dashred.physics.weights import Columns
from dashred.physics.window import Shape, Window
from dashred.sensing.observation import ObservationOperator

DIFFERENCE = 1e-5


class Simulator:
    """The simulator with every candidate in reach, compiled once for all fits.

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
        self._run: Run = compiled(system, self.terms, shapes)
        self.has_tangents = supports(system, self.terms) or supports_ode(system, self.terms)

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
        drive: Drive | None = None,
    ) -> Tensor:
        """Return trajectories ``(batch, time, field, *grid)`` with coefficients of some."""
        weights = torch.zeros((len(start), self._layout.count), dtype=torch.float64)
        weights[:, : len(self.terms)] = self._by_term(candidates, xi)
        return self._run(start, times, weights, drive)

    def run_local(
        self,
        start: Tensor,
        times: Tensor,
        candidates: Sequence[Candidate],
        everywhere: Tensor,
        inside: Tensor,
        windows: Sequence[Window],
        drive: Drive | None = None,
    ) -> Tensor:
        """Return trajectories in which candidates act within each row's window, too.

        Args:
            start: ``(batch, field, *grid)``.
            times: ``(time,)``.
            candidates: some of them.
            everywhere: their coefficients, ``(batch, candidate)``.
            inside: what is added to these within the window.
            windows: of each row.
            drive: a free forcing of each row.
        """
        plain = self._by_term(candidates, everywhere)
        local = self._by_term(candidates, inside)
        weights = self._layout.weights(plain, local, windows)
        return self._run(start, times, weights, drive)

    def tangents(
        self,
        start: Tensor,
        directions: Tensor,
        times: Tensor,
        forcing: Forcing,
        sources: Sequence[tuple[Term, ...]],
        drive: Drive | None,
        pulses: Pulses | None,
    ) -> Iterator[tuple[Tensor, Tensor]]:
        """Yield state and tangents at every sample: of the directions, the sources, the pulses."""
        base = self.tangent, start, directions, times, forcing, sources
        if self.system.axes:
            return tangent_linear(*base, torch.float32, drive, pulses)
        return tangent_ode(*base, drive, pulses)

    def visited(self, states: Tensor, times: Tensor) -> Tensor:
        """Return all states ``(sample, field, *grid)`` of a trajectory on its clock."""
        return states

    def _by_term(self, candidates: Sequence[Candidate], xi: Tensor) -> Tensor:
        weights = torch.zeros((len(xi), len(self.terms)), dtype=torch.float64)
        for j, candidate in enumerate(candidates):
            weights[:, self._columns[candidate.key]] += xi[:, j, None]
        return weights


@dataclass(frozen=True)
class Linearisation:
    """Readings about one point: ``H S(z, ξ) ≈ readings + J_z δz + J_ξ δξ``.

    Attributes:
        readings: ``(time, sensor)``.
        by_start: J_z, ``(time, sensor, mode)``.
        by_error: J_ξ in the user's units, ``(time, sensor, candidate)``.
    """

    readings: Tensor
    by_start: Tensor
    by_error: Tensor


@dataclass(frozen=True)
class Shooting:
    """``(z, ξ) → H S(u₀(z); N + Σ ξ θ)`` and its derivative (design §4.2).

    Attributes:
        simulator: S and N.
        start: u₀(z), z ~ N(0, 1).
        candidates: what ξ multiplies.
        operator: H of the fit sensors.
        times: clock of the recording's part that is fitted, ``(time,)``; of several episodes as
            :mod:`dashred.discovery.episodes` has them.
    """

    simulator: Simulator
    start: StartModel
    candidates: Sequence[Candidate]
    operator: ObservationOperator
    times: Tensor

    def until(self, samples: int) -> Shooting:
        """Return the same over the first samples alone."""
        return replace(self, times=self.times[:samples])

    def states(
        self,
        z: Float[Tensor, "batch mode"],
        xi: Float[Tensor, "batch candidate"],
        drive: Drive | None = None,
    ) -> Tensor:
        """Return the trajectories ``(batch, time, field, *grid)``, under a free forcing."""
        return self.simulator.run(self.start.start(z), self.times, self.candidates, xi, drive)

    def visited(self, z: Float[Tensor, " mode"], xi: Float[Tensor, " candidate"]) -> Tensor:
        """Return all states of one trajectory, ``(sample, field, *grid)``."""
        [states] = self.states(z[None], xi[None])
        return self.simulator.visited(states, self.times)

    def readings(self, z: Tensor, xi: Tensor) -> Float[Tensor, "batch time sensor"]:
        """Return what the sensors read; not finite from where a trajectory blows up."""
        return self.operator(self.states(z, xi))

    def linearise(
        self,
        z: Float[Tensor, " mode"],
        xi: Float[Tensor, " candidate"],
        readings: Float[Tensor, "time sensor"] | None = None,
    ) -> Linearisation:
        """Return readings and Jacobian about one point, by tangents, or else by differences.

        Args:
            z: the start.
            xi: the model error.
            readings: there, where they are known already.
        """
        if not self.simulator.has_tangents:
            return self._difference(z, xi)
        if readings is None:
            [readings] = self.readings(z[None], xi[None])
        jacobian, simulator = self._columns(z, xi), self.simulator
        whole = bool(torch.isfinite(jacobian).all()) or not bool(torch.isfinite(readings).all())
        if not whole and simulator.tangent.dt > simulator.system.dt:
            # What is stable in its own steps may not be in the derivative's.
            jacobian = self.finer()._columns(z, xi)
        return Linearisation(readings, jacobian[..., : len(z)], jacobian[..., len(z) :])

    def finer(self) -> Shooting:
        """Return the same with the simulator's own steps for its derivative."""
        return replace(self, simulator=self.simulator.finer())

    def _columns(self, z: Tensor, xi: Tensor) -> Tensor:
        """Return the Jacobian by tangents, ``(time, sensor, unknown)``."""
        eye = torch.eye(len(z), dtype=torch.float64)
        base = self.start.start(z[None])
        directions = (self.start.start(z + DIFFERENCE * eye) - base) / DIFFERENCE
        columns = [
            self._observe(state, tangents.double())
            for state, tangents in self.tangents(base[0], directions, xi)
        ]
        return torch.stack(columns)

    def tangents(
        self,
        start: Tensor,
        directions: Tensor,
        xi: Tensor,
        drive: Drive | None = None,
        pulses: Pulses | None = None,
    ) -> Iterator[tuple[Tensor, Tensor]]:
        """Yield state and tangents at every sample: of the start's directions, ξ, and pulses."""
        carried = torch.nonzero(xi).flatten().tolist()
        forcing = forcing_of([self.candidates[j] for j in carried], xi[None, carried])
        sources = [candidate.terms for candidate in self.candidates]
        return self.simulator.tangents(
            start, directions, self.times, forcing, sources, drive, pulses
        )

    @property
    def scales(self) -> Tensor:
        """A size of every ξ that makes a difference, ``(candidate,)``."""
        return torch.tensor([c.scale for c in self.candidates], dtype=torch.float64)

    def _observe(self, state: Tensor, tangents: Tensor) -> Tensor:
        """Return H' w of tangents ``(column, field, *grid)``: ``(sensor, column)``."""
        largest = tangents.abs().flatten(1).amax(dim=1).clamp(min=1e-300)
        size = DIFFERENCE * state.abs().max() / largest
        moved = state + size.reshape(-1, *(1,) * state.dim()) * tangents
        return ((self.operator(moved) - self.operator(state)) / size[:, None]).T

    def _difference(self, z: Tensor, xi: Tensor) -> Linearisation:
        steps = DIFFERENCE * torch.cat([torch.ones(len(z), dtype=torch.float64), self.scales])
        base = torch.cat([z, xi])
        moved = torch.cat([base + torch.diag(steps), base - torch.diag(steps), base[None]])
        found = self.readings(moved[:, : len(z)], moved[:, len(z) :])
        ahead, behind = found[:-1].split(len(steps))
        jacobian = ((ahead - behind) / (2 * steps[:, None, None])).permute(1, 2, 0)
        return Linearisation(found[-1], jacobian[..., : len(z)], jacobian[..., len(z) :])
