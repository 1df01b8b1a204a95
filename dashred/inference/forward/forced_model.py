"""Shooting with a free forcing: whatever the law leaves, as a map in space and time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.inference.forward.forward_model import ForwardModel
from dashred.physics.forcing_basis import ForcingBasis, SampledForcing


@dataclass(frozen=True)
class ForcedModel(ForwardModel):
    """``(z, ξ, a) → H S(u₀(z); law(ξ) + f)`` with ``f_e(x, t) = Σ a_eck b_c(x) h_k(t)``.

    Its coefficients are those of the law, then the amplitudes a.

    Attributes:
        law: what is forced: none, or one that acts everywhere or in a window.
        pulses: b and h.
        size: an amplitude of each equation that makes a difference, ``(equation,)``.
    """

    law: ForwardModel
    forcing_basis: ForcingBasis
    size: Tensor

    @classmethod
    def on(cls, law: ForwardModel, forcing_basis: ForcingBasis, size: Tensor) -> ForcedModel:
        """Return a law under a free forcing."""
        return cls(
            law.simulator,
            law.start,
            law.candidates,
            law.operator,
            law.times,
            law,
            forcing_basis,
            size,
        )

    def until(self, samples: int) -> ForcedModel:
        """Return the same over the first samples alone."""
        return replace(self, times=self.times[:samples], law=self.law.until(samples))

    def finer(self) -> ForcedModel:
        """Return the same with the simulator's own steps for its derivative."""
        law = self.law.finer()
        return replace(self, simulator=law.simulator, law=law)

    def amplitudes(self, xi: Tensor) -> Tensor:
        """Return a of coefficients ``(batch, coefficient)``: ``(batch, equation, cell, knot)``."""
        return xi[:, -self.forcing_basis.count :].reshape(-1, *self.forcing_basis.shape)

    def states(
        self, z: Tensor, xi: Tensor, sampled_forcing: SampledForcing | None = None
    ) -> Tensor:
        """Return the trajectories ``(batch, time, field, *grid)``; the forcing is its own."""
        own = (
            self.forcing_basis.sampled_forcing(self.amplitudes(xi))
            if sampled_forcing is None
            else sampled_forcing
        )
        return self.law.states(z, xi[:, : -self.forcing_basis.count], own)

    def tangents(
        self,
        start: Tensor,
        directions: Tensor,
        xi: Tensor,
        sampled_forcing: SampledForcing | None = None,
        forcing_basis: ForcingBasis | None = None,
    ) -> Iterator[tuple[Tensor, Tensor]]:
        """Yield state and tangents at every sample: of the directions, of ξ, and of a."""
        own = (
            self.forcing_basis.sampled_forcing(self.amplitudes(xi[None]))
            if sampled_forcing is None
            else sampled_forcing
        )
        law = xi[: -self.forcing_basis.count]
        return self.law.tangents(start, directions, law, own, forcing_basis or self.forcing_basis)

    @property
    def scales(self) -> Tensor:
        """A size of every coefficient that makes a difference."""
        _, cells, knots = self.forcing_basis.shape
        return torch.cat([self.law.scales, self.size.repeat_interleave(cells * knots)])
