"""Shooting with a free forcing: whatever the law leaves, as a map in space and time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from dashred.discovery.candidates import forcing_of
from dashred.discovery.shooting import Shooting
from dashred.physics.pulses import Pulses
from dashred.physics.tangent_linear import tangent_linear


@dataclass(frozen=True)
class DrivenShooting(Shooting):
    """``(z, ξ, a) → H S(u₀(z); N + Σ ξ θ + f)`` with ``f_e(x, t) = Σ a_eck b_c(x) h_k(t)``.

    Its coefficients are those of the candidates, then the amplitudes a.

    Attributes:
        pulses: b and h.
        size: an amplitude of each equation that makes a difference, ``(equation,)``.
    """

    pulses: Pulses
    size: Tensor

    def amplitudes(self, xi: Tensor) -> Tensor:
        """Return a of coefficients ``(batch, coefficient)``: ``(batch, equation, cell, knot)``."""
        return xi[:, len(self.candidates) :].reshape(-1, *self.pulses.shape)

    def states(self, z: Tensor, xi: Tensor) -> Tensor:
        """Return the trajectories ``(batch, time, field, *grid)``."""
        law, drive = xi[:, : len(self.candidates)], self.pulses.drive(self.amplitudes(xi))
        start = self.start.start(z)
        return self.simulator.run(start, self.times, self.candidates, law, drive)

    def tangents(
        self, start: Tensor, directions: Tensor, xi: Tensor
    ) -> Iterator[tuple[Tensor, Tensor]]:
        """Yield state and tangents at every sample: of the directions, of ξ, and of a."""
        return tangent_linear(
            self.simulator.tangent,
            start,
            directions,
            self.times,
            forcing_of(self.candidates, xi[None, : len(self.candidates)]),
            [candidate.terms for candidate in self.candidates],
            torch.float32,
            self.pulses.drive(self.amplitudes(xi[None])),
            self.pulses,
        )

    @property
    def scales(self) -> Tensor:
        """A size of every coefficient that makes a difference."""
        _, cells, knots = self.pulses.shape
        return torch.cat([super().scales, self.size.repeat_interleave(cells * knots)])
