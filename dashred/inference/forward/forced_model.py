"""Shooting with a free forcing: whatever the law leaves, as a map in space and time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.inference.forward.forward_model import Shooting
from dashred.physics.forcing_basis import Drive, Pulses


@dataclass(frozen=True)
class DrivenShooting(Shooting):
    """``(z, ξ, a) → H S(u₀(z); law(ξ) + f)`` with ``f_e(x, t) = Σ a_eck b_c(x) h_k(t)``.

    Its coefficients are those of the law, then the amplitudes a.

    Attributes:
        law: what is forced: none, or one that acts everywhere or in a window.
        pulses: b and h.
        size: an amplitude of each equation that makes a difference, ``(equation,)``.
    """

    law: Shooting
    pulses: Pulses
    size: Tensor

    @classmethod
    def on(cls, law: Shooting, pulses: Pulses, size: Tensor) -> DrivenShooting:
        """Return a law under a free forcing."""
        return cls(
            law.simulator,
            law.start,
            law.candidates,
            law.operator,
            law.times,
            law,
            pulses,
            size,
        )

    def until(self, samples: int) -> DrivenShooting:
        """Return the same over the first samples alone."""
        return replace(self, times=self.times[:samples], law=self.law.until(samples))

    def finer(self) -> DrivenShooting:
        """Return the same with the simulator's own steps for its derivative."""
        law = self.law.finer()
        return replace(self, simulator=law.simulator, law=law)

    def amplitudes(self, xi: Tensor) -> Tensor:
        """Return a of coefficients ``(batch, coefficient)``: ``(batch, equation, cell, knot)``."""
        return xi[:, -self.pulses.count :].reshape(-1, *self.pulses.shape)

    def states(self, z: Tensor, xi: Tensor, drive: Drive | None = None) -> Tensor:
        """Return the trajectories ``(batch, time, field, *grid)``; the forcing is its own."""
        own = self.pulses.drive(self.amplitudes(xi)) if drive is None else drive
        return self.law.states(z, xi[:, : -self.pulses.count], own)

    def tangents(
        self,
        start: Tensor,
        directions: Tensor,
        xi: Tensor,
        drive: Drive | None = None,
        pulses: Pulses | None = None,
    ) -> Iterator[tuple[Tensor, Tensor]]:
        """Yield state and tangents at every sample: of the directions, of ξ, and of a."""
        own = self.pulses.drive(self.amplitudes(xi[None])) if drive is None else drive
        law = xi[: -self.pulses.count]
        return self.law.tangents(start, directions, law, own, pulses or self.pulses)

    @property
    def scales(self) -> Tensor:
        """A size of every coefficient that makes a difference."""
        _, cells, knots = self.pulses.shape
        return torch.cat([self.law.scales, self.size.repeat_interleave(cells * knots)])
