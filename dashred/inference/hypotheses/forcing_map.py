"""The map of a free forcing in space and time, with standard deviations."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from dashred.inference.hypotheses.free_forcing import FreeForcing
from dashred.physics.forcing_basis import cell_centres


@dataclass(frozen=True)
class ForcingMap:
    """A forcing in cells of space and at knots in time, in units of each equation's tendency.

    Attributes:
        places: centre of each cell along every axis, ``(cell, axis)``.
        times: of the knots, ``(knot,)``.
        amplitudes: ``(equation, cell, knot)``.
        stds: posterior standard deviations, ``(equation, cell, knot)``.
        gain: evidence for the forcing on top of the uncorrected simulator.
    """

    places: Tensor
    times: Tensor
    amplitudes: Tensor
    stds: Tensor
    gain: float

    @property
    def peak(self) -> list[float]:
        """Place of the largest rms over time and equations: one coordinate for each axis."""
        size = self.amplitudes.square().sum(dim=(0, 2))
        return [float(x) for x in self.places[int(size.argmax())]]


def build_forcing_map(forcing: FreeForcing, gain: float) -> ForcingMap | None:
    """Return the map of a free forcing; None if all its amplitudes are zero."""
    if not any(forcing.levels):
        return None
    basis, size = forcing.block.basis, forcing.block.size[:, None, None]
    variance = forcing.normal.covariance(range(len(forcing.phi))).diagonal()[-basis.count :]
    stds = variance.clamp(min=0).sqrt().reshape(basis.shape)
    system = forcing.objective.forward_model.simulator.system
    return ForcingMap(
        cell_centres(system, basis.mesh),
        basis.knots,
        forcing.amplitudes / size,
        stds / size,
        gain,
    )
