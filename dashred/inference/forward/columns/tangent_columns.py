"""Columns of a Jacobian: derivatives of the readings by start, law and forcing.

They come from tangent-linear equations along one trajectory::

    δu' = N'(u) δu + θ(u)        δy = H'(u) δu + ∂H/∂p δp

The columns are those of the start, of the parameters and the law, and of the forcing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from dashred.core.budget import NEVER, Deadline
from dashred.inference.forward.columns.states_along import states_along
from dashred.inference.forward.forcing_block import ForcingBlock
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.forward.sensor_block import SensorBlock
from dashred.inference.forward.simulator import Simulator
from dashred.inference.initial_state.start_models import StartModel

# Step of an unknown of the start, in standard deviations of its prior.
DIFFERENCE = 1e-5


class TangentPoint(NamedTuple):
    """A point at which readings are linearised.

    Attributes:
        z: unknowns of the start, ``(mode,)``.
        unknowns: of the parameters and the law, ``(unknown,)``.
        amplitudes: unknowns of the forcing, ``(amplitude,)``.
        weights: of the law, ``(1, weight)``, for a compiled trajectory; None for one that is not.
    """

    z: Tensor
    unknowns: Tensor
    amplitudes: Tensor
    weights: Tensor | None


@dataclass(frozen=True)
class TangentColumns:
    """The columns of a forward model.

    Attributes:
        simulator: the simulators of all episodes, with tangent-linear equations.
        start: u₀(z), ``(episode, field, *grid)``.
        tendency: the uncertain parameters and the terms that are added to the tendency.
        sensors: H.
        times: ``(time, episode)``.
        forcing: f; None without one.
    """

    simulator: Simulator
    start: StartModel
    tendency: LawBlock
    sensors: SensorBlock
    times: Tensor
    forcing: ForcingBlock | None

    @property
    def count(self) -> int:
        """Number of columns."""
        return self.start.size + self.tendency.count + (self.forcing.count if self.forcing else 0)

    def at(
        self, point: TangentPoint, blocks: Sequence[slice], deadline: Deadline = NEVER
    ) -> Tensor:
        """Return some columns at a point, ``(time, sensor, column)``.

        A column is integrated and read with those of its block, whichever other blocks are wanted.

        Args:
            point: the point.
            blocks: adjacent blocks of columns, which the sensors read together.
            deadline: time at which the integration of the columns ends.

        Raises:
            OutOfTimeError: the deadline is over.
        """
        z, unknowns, amplitudes, weights = point
        forcing, first = self.forcing, blocks[0].start
        [base] = self.start.start(z[None])
        eye = torch.eye(len(z), dtype=torch.float64)
        directions = (self.start.start(z + DIFFERENCE * eye) - base) / DIFFERENCE
        spread = float(directions.abs().max()) if directions.any() else 1.0
        samples = self.simulator.tangents(
            base,
            directions,
            self.times,
            self.tendency.forcing(unknowns),
            self.tendency.sources(unknowns),
            forcing.sampled(amplitudes[None]) if forcing else None,
            forcing.basis if forcing else None,
            weights,
            slice(first, blocks[-1].stop),
        )
        found: list[Tensor] = []
        for states, tangents in samples:
            sample = sum(map(len, found))
            parts = [
                self._observe(
                    states,
                    tangents[:, b.start - first : b.stop - first],
                    unknowns,
                    sample,
                    b,
                    spread,
                )
                for b in blocks
            ]
            # The fields may be on another device; only their readings are moved.
            found.append(torch.cat(parts, dim=-1).cpu())
            deadline.check()
        return torch.cat(found)

    def _observe(
        self,
        states: Tensor,
        tangents: Tensor,
        unknowns: Tensor,
        sample: int,
        block: slice,
        spread: float,
    ) -> Tensor:
        """Return the derivative ``H'(u) w``, ``(sample, sensor, column)``, with ``∂H/∂p`` added.

        Args:
            states: u, ``(sample, episode, field, *grid)``.
            tangents: w, ``(sample, column, episode, field, *grid)``.
            unknowns: of the parameters and the law, ``(unknown,)``.
            sample: index of the first sample.
            block: the columns.
            spread: largest change of the start; the scale of a state that is zero everywhere.
        """
        read = self.sensors.parameters
        chosen = [] if read is None else read.index(self.tendency.candidates)
        if not chosen and self.sensors.operator.is_linear:
            return self.sensors.observe(tangents).to(states).transpose(1, 2)
        moved, size = states_along(states, tangents, spread)
        states = states[:, None]
        difference = self.sensors.observe(moved) - self.sensors.observe(states)
        if read is None or not chosen:
            return (difference / size[..., None]).transpose(1, 2)
        own = [self.tendency.candidates[j] for j in chosen]
        times = self.times[sample : sample + len(states)]
        # The columns are the batch of the observation.
        moved, states = moved.transpose(0, 1), states.transpose(0, 1)
        ahead, here = (
            read.effect(own, unknowns[None, chosen], each, times) for each in (moved, states)
        )
        difference = difference + (ahead - here).transpose(0, 1)
        columns = (difference / size[..., None]).transpose(1, 2).contiguous()
        [slopes] = read.columns([candidate.name for candidate in own], states, times)
        for j, slope in zip(chosen, slopes.unbind(-1), strict=True):
            if block.start <= (column := self.start.size + j) < block.stop:
                columns[..., column - block.start] += slope.to(columns.dtype)
        return columns
