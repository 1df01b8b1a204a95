"""A free forcing with unknown amplitudes: ``f_e(x, t) = Σ_ck a_eck b_c(x) h_k(t)``."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from dashred.physics.forcing_basis import ForcingBasis, SampledForcing


@dataclass(frozen=True)
class ForcingBlock:
    """A forcing with unknown amplitudes a.

    Attributes:
        basis: the basis functions b and h.
        size: natural scale of the amplitudes of each equation, ``(equation,)``.
    """

    basis: ForcingBasis
    size: Tensor

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return self.basis.count

    @property
    def scales(self) -> Tensor:
        """Natural scale of every amplitude, ``(unknown,)``."""
        return self.by_amplitude(self.size)

    def by_amplitude(self, values: Tensor) -> Tensor:
        """Return one value of each equation repeated for all of its amplitudes, ``(unknown,)``."""
        _, cells, courses = self.basis.shape
        return values.repeat_interleave(cells * courses)

    def amplitudes(self, unknowns: Tensor) -> Tensor:
        """Return amplitudes ``(row, equation, cell, course)`` from rows of unknowns."""
        return unknowns.reshape(-1, *self.basis.shape)

    def sampled(self, unknowns: Tensor) -> SampledForcing:
        """Return the forcing for rows of unknowns, ``(row, unknown)``."""
        return self.basis.sampled_forcing(self.amplitudes(unknowns))
