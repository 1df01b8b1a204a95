"""Shooting: from a start and a model error, through the simulator, to what the sensors read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.inference.forward.candidate_simulator import Simulator
from dashred.inference.forward.candidates import Candidate, forcing_of
from dashred.inference.initial_state.start_models import StartModel
from dashred.physics.forcing_basis import ForcingBasis, SampledForcing

DIFFERENCE = 1e-5
# Numbers of tangents that are observed together: calls of few would cost more than their sums.
AT_ONCE = 2**16


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
class ForwardModel:
    """``(z, ξ) → H S(u₀(z); N + Σ ξ θ)`` and its derivative (design §4.2).

    Attributes:
        simulator: S and N.
        start: u₀(z), z ~ N(0, 1).
        candidates: what ξ multiplies.
        operator: H of the fit sensors.
        times: clock of the recording's part that is fitted, ``(time,)``; of several episodes as
            :mod:`dashred.inference.forward.episodes` has them.
    """

    simulator: Simulator
    start: StartModel
    candidates: Sequence[Candidate]
    operator: ObservationOperator
    times: Tensor

    def until(self, samples: int) -> ForwardModel:
        """Return the same over the first samples alone."""
        return replace(self, times=self.times[:samples])

    def states(
        self,
        z: Float[Tensor, "batch mode"],
        xi: Float[Tensor, "batch candidate"],
        sampled_forcing: SampledForcing | None = None,
    ) -> Tensor:
        """Return the trajectories ``(batch, time, field, *grid)``, under a free forcing."""
        return self.simulator.run(
            self.start.start(z), self.times, self.candidates, xi, sampled_forcing
        )

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

    def finer(self) -> ForwardModel:
        """Return the same with the simulator's own steps for its derivative."""
        return replace(self, simulator=self.simulator.finer())

    def _columns(self, z: Tensor, xi: Tensor) -> Tensor:
        """Return the Jacobian by tangents, ``(time, sensor, unknown)``."""
        eye = torch.eye(len(z), dtype=torch.float64)
        base = self.start.start(z[None])
        directions = (self.start.start(z + DIFFERENCE * eye) - base) / DIFFERENCE
        samples = _together(self.tangents(base[0], directions, xi))
        return torch.cat([self._observe(states, tangents) for states, tangents in samples])

    def tangents(
        self,
        start: Tensor,
        directions: Tensor,
        xi: Tensor,
        sampled_forcing: SampledForcing | None = None,
        forcing_basis: ForcingBasis | None = None,
    ) -> Iterator[tuple[Tensor, Tensor]]:
        """Yield state and tangents at every sample: of the start's directions, ξ, and pulses."""
        carried = torch.nonzero(xi).flatten().tolist()
        forcing = forcing_of([self.candidates[j] for j in carried], xi[None, carried])
        sources = [candidate.terms for candidate in self.candidates]
        return self.simulator.tangents(
            start, directions, self.times, forcing, sources, sampled_forcing, forcing_basis
        )

    @property
    def scales(self) -> Tensor:
        """A size of every ξ that makes a difference, ``(candidate,)``."""
        return torch.tensor([c.scale for c in self.candidates], dtype=torch.float64)

    def _observe(self, states: Tensor, tangents: Tensor) -> Tensor:
        """Return H' w of tangents ``(sample, column, field, *grid)``: ``(sample, sensor, column)``.

        Args:
            states: about which, ``(sample, field, *grid)``.
            tangents: w.
        """
        largest = tangents.abs().flatten(2).amax(dim=2).clamp(min=1e-300)
        size = DIFFERENCE * states.abs().flatten(1).amax(dim=1, keepdim=True) / largest
        states = states[:, None]
        moved = states + size.reshape(*size.shape, *(1,) * (states.dim() - 2)) * tangents
        difference = self.operator(moved) - self.operator(states)
        return (difference / size[..., None]).transpose(1, 2)

    def _difference(self, z: Tensor, xi: Tensor) -> Linearisation:
        steps = DIFFERENCE * torch.cat([torch.ones(len(z), dtype=torch.float64), self.scales])
        base = torch.cat([z, xi])
        moved = torch.cat([base + torch.diag(steps), base - torch.diag(steps), base[None]])
        found = self.readings(moved[:, : len(z)], moved[:, len(z) :])
        ahead, behind = found[:-1].split(len(steps))
        jacobian = ((ahead - behind) / (2 * steps[:, None, None])).permute(1, 2, 0)
        return Linearisation(found[-1], jacobian[..., : len(z)], jacobian[..., len(z) :])


def _together(samples: Iterator[tuple[Tensor, Tensor]]) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield states and tangents of as many samples as are few numbers: one call observes all."""
    states: list[Tensor] = []
    tangents: list[Tensor] = []
    for state, columns in samples:
        states.append(state)
        tangents.append(columns.double())
        if len(states) * columns.numel() >= AT_ONCE:
            yield torch.stack(states), torch.stack(tangents)
            states, tangents = [], []
    if states:
        yield torch.stack(states), torch.stack(tangents)
