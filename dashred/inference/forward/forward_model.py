"""The forward model: it maps a start and a law, through the simulator, to sensor readings.

It is composed of blocks with unknowns of their own::

    u(0) = u₀(z)                                    start
    ∂u/∂t = N(u; p) + Σ ξ θ(u) + f(x, t)            simulator, parameters, law, forcing
    y = H(u; p) + errors                            sensors

The unknowns are z of the start and of uncertain parameters p, and one vector of coefficients: those
of the law, then those of the forcing, then those of the sensor errors. Every array has an episode
axis; a single recording is one episode.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.core.budget import NEVER, Deadline
from dashred.inference.forward.columns.column_blocks import compute_columns, is_large
from dashred.inference.forward.columns.tangent_columns import (
    DIFFERENCE,
    TangentColumns,
    TangentPoint,
)
from dashred.inference.forward.episodes import concatenate_episodes
from dashred.inference.forward.forcing_block import ForcingBlock
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.forward.sensor_block import SensorBlock
from dashred.inference.forward.simulator import Simulator
from dashred.inference.initial_state.start_models import StartModel, project_state


@dataclass(frozen=True)
class Linearisation:
    """Readings linearised at one point: ``y ≈ readings + J_z δz + J_ξ δξ``.

    Attributes:
        readings: ``(time, sensor)``.
        by_start: J_z, ``(time, sensor, mode)``: start, then uncertain parameters.
        by_coefficients: J_ξ in the user's units, ``(time, sensor, coefficient)``.
    """

    readings: Tensor
    by_start: Tensor
    by_coefficients: Tensor


class UnknownSlices(NamedTuple):
    """The slice of each block in the vector of coefficients."""

    law: slice
    forcing: slice
    errors: slice


@dataclass(frozen=True)
class ForwardModel:
    """``(z, ξ) → y`` and its derivative (docs/method.md#fit-through-the-simulator).

    Attributes:
        simulator: the simulators of all episodes, with tendency N and uncertain parameters.
        start: u₀(z) with z ~ N(0, I), ``(episode, field, *grid)``.
        law: the terms added to N.
        sensors: H and the sensor errors.
        times: times of the fitted samples, ``(time, episode)``.
        forcing: f; None without one.
    """

    simulator: Simulator
    start: StartModel
    law: LawBlock
    sensors: SensorBlock
    times: Tensor
    forcing: ForcingBlock | None = None

    @property
    def modes(self) -> int:
        """Number of unknowns z, of the start and the uncertain parameters."""
        return self.start.size + self.simulator.parameters.count

    @property
    def slices(self) -> UnknownSlices:
        """The slice of each block in the vector of coefficients."""
        law = self.law.count
        forcing = law + (self.forcing.count if self.forcing else 0)
        return UnknownSlices(
            slice(law), slice(law, forcing), slice(forcing, forcing + self.sensors.count)
        )

    def truncate(self, samples: int) -> ForwardModel:
        """Return the forward model of the first samples."""
        return replace(self, times=self.times[:samples])

    def states(
        self, z: Float[Tensor, "batch mode"], xi: Float[Tensor, "batch coefficient"]
    ) -> Tensor:
        """Return the trajectories ``(batch, time, episode, field, *grid)``."""
        forcing = self.forcing.sampled(xi[:, self.slices.forcing]) if self.forcing else None
        weights = self._tendency.weights(self.simulator, self._tendency_unknowns(z, xi))
        return self.simulator.run(self.starts(z), self.times, weights, forcing)

    def starts(self, z: Float[Tensor, "batch mode"]) -> Tensor:
        """Return the starts ``(batch, episode, field, *grid)``."""
        return self.start.start(z[:, : self.start.size])

    def scaled_changes(self, changes: Float[Tensor, " parameter"]) -> Tensor:
        """Return the unknowns z of the uncertain parameters for given changes."""
        known = self.simulator.parameters
        return (changes - known.means) / known.stds

    def move_to(self, start: StartModel, z: Float[Tensor, " mode"]) -> Tensor:
        """Return z with the start expressed by another model, as nearly as it can."""
        if start is self.start:
            return z
        begin = project_state(start, self.starts(z[None])[0])
        return torch.cat([begin, z[self.start.size :]])

    def parameter_changes(self, z: Float[Tensor, "*batch mode"]) -> Tensor:
        """Return the changes of the uncertain parameters, ``(…, parameter)``."""
        known = self.simulator.parameters
        return known.means + known.stds * z[..., self.start.size :]

    def sampled_states(
        self, z: Float[Tensor, " mode"], xi: Float[Tensor, " coefficient"]
    ) -> Tensor:
        """Return the states of one run, ``(sample, field, *grid)``, episode after episode."""
        [states] = self.states(z[None], xi[None])
        return concatenate_episodes(states, self.times)

    def readings(self, z: Tensor, xi: Tensor) -> Float[Tensor, "batch time sensor"]:
        """Return the readings; they are not finite after a blow-up."""
        states = self.states(z, xi)
        exact = self.observe(states, self._tendency_unknowns(z, xi))
        return self.sensors.with_errors(exact, states, xi[:, self.slices.errors])

    def observe(self, states: Tensor, unknowns: Tensor, first: int = 0) -> Tensor:
        """Return the readings without sensor errors, ``(batch, time, sensor)``.

        Args:
            states: ``(batch, time, episode, field, *grid)``.
            unknowns: of the parameters and the law, ``(batch, unknown)``.
            first: index of the first sample.
        """
        found, read, law = self.sensors.observe(states), self.sensors.parameters, self._tendency
        if read is None or not (chosen := read.index(law.candidates)):
            return found
        times = self.times[first : first + states.shape[1]]
        own = [law.candidates[j] for j in chosen]
        return found + read.effect(own, unknowns[:, chosen], states, times)

    def linearise(
        self,
        z: Float[Tensor, " mode"],
        xi: Float[Tensor, " coefficient"],
        readings: Float[Tensor, "time sensor"] | None = None,
        deadline: Deadline = NEVER,
    ) -> Linearisation:
        """Return the readings and their Jacobian at one point.

        The Jacobian comes from tangent-linear equations, or from central differences if there are
        none. The columns of start, law and forcing do not include the sensor errors.

        Args:
            z: unknowns of the start.
            xi: coefficients.
            readings: readings at the point, if they are known already.
            deadline: time at which the integration of the derivatives ends.

        Raises:
            OutOfTimeError: the deadline is over.
        """
        if readings is None:
            [readings] = self.readings(z[None], xi[None])
        jacobian, simulator = self._jacobian(z, xi, deadline), self.simulator
        is_usable = bool(torch.isfinite(jacobian).all()) or not bool(torch.isfinite(readings).all())
        if not is_usable and simulator.tangent.dt > simulator.system.dt:
            # The larger time step of the derivative may be unstable.
            jacobian = self.finer()._jacobian(z, xi, deadline)
        by_coefficients = jacobian[..., len(z) :]
        if self.sensors.errors:
            [states] = self.states(z[None], xi[None])
            [exact] = self.observe(states[None], self._tendency_unknowns(z, xi)[None])
            columns = self.sensors.columns(exact, states, xi[self.slices.errors])
            by_coefficients = torch.cat(
                [by_coefficients, columns.to(by_coefficients.dtype)], dim=-1
            )
        return Linearisation(readings, jacobian[..., : len(z)], by_coefficients)

    def finer(self) -> ForwardModel:
        """Return the forward model with the time step of the simulator for its derivative, too."""
        return replace(self, simulator=self.simulator.finer())

    @property
    def scales(self) -> Tensor:
        """Natural scales of the coefficients of law and forcing, ``(coefficient,)``."""
        return torch.cat([block.scales for block in (self.law, self.forcing) if block])

    def _jacobian(self, z: Tensor, xi: Tensor, deadline: Deadline = NEVER) -> Tensor:
        """Return the columns of start, law and forcing, ``(time, sensor, unknown)``."""
        if self.simulator.has_tangents:
            return self._columns(z, xi, deadline)
        return self._differences(z, xi)

    @property
    def _tendency(self) -> LawBlock:
        """The uncertain parameters and the law: all that is added to the tendency but a forcing."""
        known = self.simulator.parameters.candidates
        return replace(self.law, candidates=[*known, *self.law.candidates]) if known else self.law

    def _tendency_unknowns(self, z: Tensor, xi: Tensor) -> Tensor:
        """Return the unknowns of the parameters and the law, ``(…, unknown)``."""
        return torch.cat([self.parameter_changes(z), xi[..., self.slices.law]], dim=-1)

    @property
    def has_large_jacobian(self) -> bool:
        """Whether the Jacobian is worth the workers of a cluster."""
        return self.simulator.has_tangents and is_large(self._tangent_columns)

    @property
    def _tangent_columns(self) -> TangentColumns:
        return TangentColumns(
            self.simulator, self.start, self._tendency, self.sensors, self.times, self.forcing
        )

    def _columns(self, z: Tensor, xi: Tensor, deadline: Deadline = NEVER) -> Tensor:
        """Return the Jacobian from tangent-linear equations."""
        simulator, size, unknowns = self.simulator, self.start.size, self._tendency_unknowns(z, xi)
        weights = self._tendency.compiled_weights(simulator, unknowns)
        point = TangentPoint(z[:size], unknowns, xi[self.slices.forcing], weights)
        found = compute_columns(self._tangent_columns, point, deadline)
        found[..., size : len(z)] *= simulator.parameters.stds.to(found.dtype)
        return found

    def _differences(self, z: Tensor, xi: Tensor) -> Tensor:
        """Return the Jacobian by central differences."""
        scales, errors = self.scales, xi[self.slices.errors]
        steps = DIFFERENCE * torch.cat([torch.ones_like(z), scales, torch.zeros_like(errors)])
        moves = torch.diag(steps)[: len(z) + len(scales)]
        moved = torch.cat([z, xi]) + torch.cat([moves, -moves])
        rows = moved[:, : len(z)], moved[:, len(z) :]
        found = self.observe(self.states(*rows), self._tendency_unknowns(*rows))
        ahead, behind = found.split(len(moves))
        steps = steps[: len(moves), None, None]
        return ((ahead - behind) / (2 * steps)).permute(1, 2, 0)
