"""The forward model: from a start and a law, through the simulator, to what the sensors read.

It is composed of blocks, each with its own unknowns::

    u(0) = u₀(z)                                    start
    ∂u/∂t = N(u) + Σ ξ θ(u) + f(x, t)               simulator, law, forcing
    y = H u + errors                                sensors

The unknowns are the start's z and one vector of coefficients: of the law, then of the forcing, then
of the sensors' errors. Every array has an episode axis; a single recording is one episode.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.inference.forward.episodes import concatenate_episodes
from dashred.inference.forward.forcing_block import ForcingBlock
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.forward.sensor_block import SensorBlock
from dashred.inference.forward.simulator import Simulator
from dashred.inference.initial_state.start_models import StartModel

DIFFERENCE = 1e-5


@dataclass(frozen=True)
class Linearisation:
    """Readings about one point: ``y ≈ readings + J_z δz + J_ξ δξ``.

    Attributes:
        readings: ``(time, sensor)``.
        by_start: J_z, ``(time, sensor, mode)``.
        by_coefficients: J_ξ in the user's units, ``(time, sensor, coefficient)``.
    """

    readings: Tensor
    by_start: Tensor
    by_coefficients: Tensor


class UnknownSlices(NamedTuple):
    """Where the unknowns of each block stand in the vector of coefficients."""

    law: slice
    forcing: slice
    errors: slice


@dataclass(frozen=True)
class ForwardModel:
    """``(z, ξ) → y`` and its derivative (docs/method.md#fit-through-the-simulator).

    Attributes:
        simulator: N, of every episode.
        start: u₀(z), z ~ N(0, 1), ``(episode, field, *grid)``.
        law: what is added to N.
        sensors: H, and errors of the sensors.
        times: clock of the part of the recording that is fitted, ``(time, episode)``.
        forcing: f; None without one.
    """

    simulator: Simulator
    start: StartModel
    law: LawBlock
    sensors: SensorBlock
    times: Tensor
    forcing: ForcingBlock | None = None

    @property
    def slices(self) -> UnknownSlices:
        """Where the unknowns of each block stand in the vector of coefficients."""
        law = self.law.count
        forcing = law + (self.forcing.count if self.forcing else 0)
        return UnknownSlices(
            slice(law), slice(law, forcing), slice(forcing, forcing + self.sensors.count)
        )

    def truncate(self, samples: int) -> ForwardModel:
        """Return the same over the first samples alone."""
        return replace(self, times=self.times[:samples])

    def states(
        self, z: Float[Tensor, "batch mode"], xi: Float[Tensor, "batch coefficient"]
    ) -> Tensor:
        """Return the trajectories ``(batch, time, episode, field, *grid)``."""
        places = self.slices
        weights = self.law.weights(self.simulator, xi[:, places.law])
        forcing = self.forcing.sampled(xi[:, places.forcing]) if self.forcing else None
        return self.simulator.run(self.start.start(z), self.times, weights, forcing)

    def sampled_states(
        self, z: Float[Tensor, " mode"], xi: Float[Tensor, " coefficient"]
    ) -> Tensor:
        """Return all states of one run, ``(sample, field, *grid)``, episode after episode."""
        [states] = self.states(z[None], xi[None])
        return concatenate_episodes(states, self.times)

    def readings(self, z: Tensor, xi: Tensor) -> Float[Tensor, "batch time sensor"]:
        """Return what the sensors read; not finite from where a trajectory blows up."""
        return self.sensors.read(self.states(z, xi), xi[:, self.slices.errors])

    def linearise(
        self,
        z: Float[Tensor, " mode"],
        xi: Float[Tensor, " coefficient"],
        readings: Float[Tensor, "time sensor"] | None = None,
    ) -> Linearisation:
        """Return readings and Jacobian about one point, by tangents, or else by differences.

        The columns of start, law and forcing are taken without the sensors' errors.

        Args:
            z: the start.
            xi: the coefficients.
            readings: there, where they are known already.
        """
        if readings is None:
            [readings] = self.readings(z[None], xi[None])
        jacobian, simulator = self._jacobian(z, xi), self.simulator
        whole = bool(torch.isfinite(jacobian).all()) or not bool(torch.isfinite(readings).all())
        if not whole and simulator.tangent.dt > simulator.system.dt:
            # What is stable in its own steps may not be in the derivative's.
            jacobian = self.finer()._jacobian(z, xi)
        by_coefficients = jacobian[..., len(z) :]
        if self.sensors.errors is not None:
            [states] = self.states(z[None], xi[None])
            columns = self.sensors.columns(states, xi[self.slices.errors])
            by_coefficients = torch.cat(
                [by_coefficients, columns.to(by_coefficients.dtype)], dim=-1
            )
        return Linearisation(readings, jacobian[..., : len(z)], by_coefficients)

    def finer(self) -> ForwardModel:
        """Return the same with the simulator's own time steps for its derivative."""
        return replace(self, simulator=self.simulator.finer())

    @property
    def scales(self) -> Tensor:
        """A change of every coefficient of law and forcing that makes a difference."""
        return torch.cat([block.scales for block in (self.law, self.forcing) if block])

    def _jacobian(self, z: Tensor, xi: Tensor) -> Tensor:
        """Return the columns of start, law and forcing, ``(time, sensor, unknown)``."""
        return (self._columns if self.simulator.has_tangents else self._differences)(z, xi)

    def _columns(self, z: Tensor, xi: Tensor) -> Tensor:
        """Return the Jacobian by tangents."""
        eye = torch.eye(len(z), dtype=torch.float64)
        [base] = self.start.start(z[None])
        directions = (self.start.start(z + DIFFERENCE * eye) - base) / DIFFERENCE
        places, forcing = self.slices, self.forcing
        blocks = self.simulator.tangents(
            base,
            directions,
            self.times,
            self.law.forcing(xi[places.law]),
            self.law.sources(xi[places.law]),
            forcing.sampled(xi[None, places.forcing]) if forcing else None,
            forcing.basis if forcing else None,
        )
        return torch.cat([self._observe(*block) for block in blocks])

    def _observe(self, states: Tensor, tangents: Tensor) -> Tensor:
        """Return H' w of tangents ``(sample, column, …)``: ``(sample, sensor, column)``.

        Args:
            states: about which, ``(sample, episode, field, *grid)``.
            tangents: w, ``(sample, column, episode, field, *grid)``.
        """
        largest = tangents.abs().flatten(2).amax(dim=2).clamp(min=1e-300)
        size = DIFFERENCE * states.abs().flatten(1).amax(dim=1, keepdim=True) / largest
        states = states[:, None]
        moved = states + size.reshape(*size.shape, *(1,) * (states.dim() - 2)) * tangents
        difference = self.sensors.observe(moved) - self.sensors.observe(states)
        return (difference / size[..., None]).transpose(1, 2)

    def _differences(self, z: Tensor, xi: Tensor) -> Tensor:
        """Return the Jacobian by central differences."""
        scales, errors = self.scales, xi[self.slices.errors]
        steps = DIFFERENCE * torch.cat([torch.ones_like(z), scales, torch.zeros_like(errors)])
        moves = torch.diag(steps)[: len(z) + len(scales)]
        moved = torch.cat([z, xi]) + torch.cat([moves, -moves])
        found = self.sensors.observe(self.states(moved[:, : len(z)], moved[:, len(z) :]))
        ahead, behind = found.split(len(moves))
        steps = steps[: len(moves), None, None]
        return ((ahead - behind) / (2 * steps)).permute(1, 2, 0)
