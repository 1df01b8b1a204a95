"""The map of a free forcing: what would have to be added where and when, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from dashred.inference.hypotheses.free_forcing import FreeForcing
from dashred.physics.system import System


@dataclass(frozen=True)
class ForcingMap:
    """A forcing in cells of space and at knots in time, in units of each equation's tendency.

    Attributes:
        places: middle of each cell along every axis, ``(cell, axis)``.
        times: of the knots, ``(knot,)``.
        amplitudes: ``(equation, cell, knot)``.
        stds: posterior standard deviations, ``(equation, cell, knot)``.
        gain: evidence for it, on top of the simulator as it is.
    """

    places: Tensor
    times: Tensor
    amplitudes: Tensor
    stds: Tensor
    gain: float

    @property
    def peak(self) -> list[float]:
        """Where it is largest, rms over time and equations: one number along every axis."""
        size = self.amplitudes.square().sum(dim=(0, 2))
        return [float(x) for x in self.places[int(size.argmax())]]


def map_of(forced: FreeForcing, gain: float) -> ForcingMap | None:
    """Return the map of a free forcing; None of one that is none."""
    if not any(forced.levels):
        return None
    basis, size = forced.block.basis, forced.block.size[:, None, None]
    variance = forced.normal.covariance(range(len(forced.phi))).diagonal()[-basis.count :]
    stds = variance.clamp(min=0).sqrt().reshape(basis.shape)
    system = forced.objective.forward_model.simulator.system
    return ForcingMap(
        _places(system, len(basis.bumps)),
        basis.knots,
        forced.amplitudes / size,
        stds / size,
        gain,
    )


def _places(system: System, cells: int) -> Tensor:
    """Return the middles of the cells, in the order in which the pulses have them."""
    if not system.axes:
        return torch.zeros((1, 0), dtype=torch.float64)
    along = round(cells ** (1 / len(system.axes)))
    middles = [
        (torch.arange(along, dtype=torch.float64) + 0.5) * axis.length / along
        for axis in system.axes
    ]
    return torch.stack(torch.meshgrid(*middles, indexing="ij"), dim=-1).flatten(0, -2)
