"""A free forcing as a block of unknowns: ``f_e(x, t) = Σ_ck a_eck b_c(x) h_k(t)``."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from dashred.physics.forcing_basis import ForcingBasis, SampledForcing


@dataclass(frozen=True)
class ForcingBlock:
    """A forcing whose amplitudes a are unknown.

    Attributes:
        basis: b and h.
        size: an amplitude of each equation that makes a difference, ``(equation,)``.
    """

    basis: ForcingBasis
    size: Tensor

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return self.basis.count

    @property
    def scales(self) -> Tensor:
        """A change of every amplitude that makes a difference, ``(unknown,)``."""
        return self.by_amplitude(self.size)

    def by_amplitude(self, values: Tensor) -> Tensor:
        """Return a value of each equation, once for each of its amplitudes, ``(unknown,)``."""
        _, cells, knots = self.basis.shape
        return values.repeat_interleave(cells * knots)

    def amplitudes(self, unknowns: Tensor) -> Tensor:
        """Return rows of unknowns as amplitudes, ``(row, equation, cell, knot)``."""
        return unknowns.reshape(-1, *self.basis.shape)

    def sampled(self, unknowns: Tensor) -> SampledForcing:
        """Return the forcing of rows of unknowns, ``(row, unknown)``."""
        return self.basis.sampled_forcing(self.amplitudes(unknowns))
