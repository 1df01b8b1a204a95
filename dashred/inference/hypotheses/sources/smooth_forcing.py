"""A smooth free forcing on a fine mesh of cells and knots, to locate what no law explains.

The amplitudes are Gaussian processes in space and time. Their correlation lengths and their size
are chosen by the evidence. A coarse free forcing gives the trajectory to linearise about.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import torch
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem, NormalEquations
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.forward.forcing_block import ForcingBlock
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.hypotheses.forcing_levels import ZERO_LEVEL, evidence
from dashred.inference.hypotheses.forcing_map import ForcingMap
from dashred.inference.hypotheses.free_forcing import (
    FreeForcing,
)
from dashred.physics.forcing_basis import ForcingBasis, cell_centres
from dashred.physics.system import System

# Fewest and most cells along each axis by the number of axes, and knots in time. There are up to
# CELLS_PER_SENSOR cells for each sensor, and one knot for SAMPLES_PER_KNOT samples.
CELLS, KNOTS = ((1, 1), (16, 36), (5, 8)), (13, 48)
CELLS_PER_SENSOR, SAMPLES_PER_KNOT = 2, 2
# Largest number of amplitudes; each is a column of the Jacobian.
MAX_AMPLITUDES = 1500
# Choices of the correlation lengths, in cells and knots, and of a factor on the levels of the
# coarse forcing.
LENGTHS, LEVEL_FACTORS = (0.7, 1.4, 2.8), (0.3, 1.0, 3.0)
# Modes of the Gaussian process with a smaller share of the largest variance are left out.
SMALLEST_MODE = 1e-4
STEPS, TOLERANCE = 2, 0.01


@dataclass(frozen=True)
class LinearisedForcing:
    """The problem of a free forcing, linearised about a trajectory that explains the recording.

    Attributes:
        objective: F of the start, the law and the amplitudes.
        block: the forcing; its amplitudes are those of cells and hat functions.
        normal: F linearised about the trajectory.
    """

    objective: LeastSquaresProblem
    block: ForcingBlock
    normal: NormalEquations

    @property
    def own(self) -> int:
        """Number of unknowns of the start and the law, which come first."""
        return len(self.normal.phi) - self.block.count

    def without_law(self) -> LinearisedForcing:
        """Return the problem without the law under the forcing: the forcing has to explain it."""
        kept = [*range(self.objective.modes), *range(self.own, len(self.normal.phi))]
        stds = self.objective.prior_std[-self.block.count :]
        model = replace(self.objective.forward_model, law=LawBlock(()))
        normal = replace(
            self.normal,
            jacobian=self.normal.jacobian[:, kept],
            precision=self.normal.precision[kept],
            phi=torch.zeros(len(kept), dtype=torch.float64),
            residuals=-self.normal.target,
        )
        objective = replace(self.objective, forward_model=model, prior_std=stds)
        return LinearisedForcing(objective, self.block, normal)


@dataclass(frozen=True)
class SmoothForcing:
    """A smooth forcing: ``a = L η`` in cells and at knots, with independent unknowns η.

    Attributes:
        forcing: the forcing of the unknowns η.
        cells: the part of L in space, ``(cell, mode)``.
        knots: the part of L in time, ``(knot, mode)``.
    """

    forcing: FreeForcing
    cells: Tensor
    knots: Tensor

    @property
    def amplitudes(self) -> Tensor:
        """a, ``(equation, cell, knot)``."""
        return self.cells @ self.forcing.amplitudes @ self.knots.T

    @property
    def stds(self) -> Tensor:
        """Posterior standard deviations of a, ``(equation, cell, knot)``."""
        block = self.forcing.block
        everything = range(len(self.forcing.phi))
        covariance = self.forcing.normal.covariance(everything)[-block.count :, -block.count :]
        fields, modes, courses = block.basis.shape
        parts = covariance.reshape(fields, modes * courses, fields, modes * courses)
        rows = torch.kron(self.cells, self.knots)
        found = [((rows @ parts[e, :, e]) * rows).sum(dim=1) for e in range(fields)]
        shape = fields, len(self.cells), len(self.knots)
        return torch.stack(found).clamp(min=0).sqrt().reshape(shape)


def linearise_fine_forcing(forcing: FreeForcing) -> LinearisedForcing:
    """Return a forcing on a fine mesh, linearised about the trajectory of a coarse forcing."""
    coarse, objective = forcing.block, forcing.objective
    model = objective.forward_model
    system = model.simulator.system
    cells, knots = _mesh(system, objective.recorded.shape[0], len(model.sensors.sensors))
    basis = ForcingBasis.over(system, model.times, cells, knots)
    block = ForcingBlock(basis, coarse.size)
    own = len(forcing.phi) - coarse.count
    without = replace(objective, prior_std=objective.prior_std[: own - objective.modes])
    whole = without.with_unknowns(replace(model, forcing=block), block.scales)
    begin = torch.cat([forcing.phi[:own], _project(forcing, basis).flatten()])
    return LinearisedForcing(whole, block, whole.linearise(begin))


def fit_smooth_forcing(fine: LinearisedForcing, levels: tuple[float, ...]) -> SmoothForcing:
    """Fit a smooth forcing; the evidence chooses its correlation lengths and its size.

    Args:
        fine: the linearised forcing on a fine mesh.
        levels: levels of the coarse forcing, one for each equation.
    """
    block, system = fine.block, fine.objective.forward_model.simulator.system
    best = math.inf, fine, torch.empty(0), torch.empty(0), levels
    for along, later in product(LENGTHS if system.axes else LENGTHS[:1], LENGTHS):
        cells, knots = (
            _modes_in_space(system, block.basis.mesh, along),
            modes_in_time(len(block.basis.knots), later),
        )
        smooth = _with_modes(fine, cells, knots)
        for factor in LEVEL_FACTORS:
            scaled = tuple(factor * level for level in levels)
            normal = smooth.normal.with_precision(_precision(smooth, scaled))
            found = evidence(normal, range(len(normal.phi)))
            if found < best[0]:
                chosen = replace(smooth, normal=normal)
                best = found, chosen, cells, knots, scaled
    _, smooth, cells, knots, scaled = best
    objective = replace(
        smooth.objective, prior_std=smooth.normal.precision[smooth.objective.modes :] ** -0.5
    )
    phi = smooth.normal.solution(range(len(smooth.normal.phi)))
    fitted = minimise(objective, phi, STEPS, TOLERANCE)
    normal = objective.linearise(fitted.phi, fitted.readings)
    equations = tuple(e for e, level in enumerate(scaled) if level)
    forcing = FreeForcing(
        objective, smooth.block, fitted.phi, fitted.cost, normal, scaled, equations
    )
    return SmoothForcing(forcing, cells, knots)


def build_smooth_map(smooth: SmoothForcing, gain: float) -> ForcingMap:
    """Return the map of a smooth forcing in cells and at knots."""
    basis, size = smooth.forcing.block.basis, smooth.forcing.block.size[:, None, None]
    system = smooth.forcing.objective.forward_model.simulator.system
    centres = cell_centres(system, basis.mesh)
    return ForcingMap(centres, basis.knots, smooth.amplitudes / size, smooth.stds / size, gain)


def _mesh(system: System, samples: int, sensors: int) -> tuple[int, int]:
    """Return the number of cells along each axis and of knots in time."""
    axes = len(system.axes)
    fewest, most = CELLS[axes]
    cells = round((CELLS_PER_SENSOR * sensors) ** (1 / axes)) if axes else 1
    cells = min(max(cells, fewest), most)
    whole = MAX_AMPLITUDES // (len(system.fields) * cells**axes)
    return cells, min(max(samples // SAMPLES_PER_KNOT, KNOTS[0]), KNOTS[1], max(whole, KNOTS[0]))


def _project(forcing: FreeForcing, basis: ForcingBasis) -> Tensor:
    """Return the amplitudes of the nearest forcing in another basis."""
    coarse = forcing.block.basis
    at_knots = forcing.amplitudes @ torch.from_numpy(coarse.hats(basis.knots.numpy())).T
    fine, old = basis.bumps.flatten(1).T, coarse.bumps.flatten(1).T
    cells = torch.linalg.lstsq(fine, old, driver="gelsd").solution
    return cells @ at_knots


def _with_modes(fine: LinearisedForcing, cells: Tensor, knots: Tensor) -> LinearisedForcing:
    """Return the same problem in the unknowns η of ``a = L η``, with its linearisation."""
    basis, own = fine.block.basis, fine.own
    shape = len(fine.normal.residuals), *basis.shape
    columns = cells.T @ fine.normal.jacobian[:, own:].reshape(shape) @ knots
    bumps = torch.tensordot(cells.T, basis.bumps, dims=1)
    smooth = ForcingBlock(replace(basis, bumps=bumps, courses=knots), fine.block.size)
    jacobian = torch.cat([fine.normal.jacobian[:, :own], columns.flatten(1)], dim=1)
    normal = NormalEquations(
        jacobian,
        torch.cat([fine.normal.precision[:own], smooth.scales**-2]),
        torch.zeros(jacobian.shape[1], dtype=torch.float64),
        -fine.normal.target,
    )
    model = replace(fine.objective.forward_model, forcing=smooth)
    stds = torch.cat([fine.objective.prior_std[: -fine.block.count], smooth.scales])
    return LinearisedForcing(
        replace(fine.objective, forward_model=model, prior_std=stds), smooth, normal
    )


def _precision(fine: LinearisedForcing, levels: tuple[float, ...]) -> Tensor:
    shares = torch.tensor([max(level, ZERO_LEVEL) for level in levels], dtype=torch.float64)
    stds = fine.block.by_amplitude(shares * fine.block.size)
    return torch.cat([fine.normal.precision[: fine.own], stds**-2])


def _modes_in_space(system: System, mesh: Sequence[int], length: float) -> Tensor:
    """Return the modes of a Gaussian process over the cells, ``(cell, mode)``."""
    if not system.axes:
        return torch.ones((1, 1), dtype=torch.float64)
    centres = cell_centres(system, mesh)
    squares = torch.zeros((len(centres), len(centres)), dtype=torch.float64)
    for index, axis in enumerate(system.axes):
        apart = (centres[:, None, index] - centres[None, :, index]).abs()
        if axis.periodic:
            apart = torch.minimum(apart, axis.length - apart)
        squares += (apart * mesh[index] / axis.length) ** 2
    return _modes(torch.exp(-squares / (2 * length**2)))


def modes_in_time(knots: int, length: float) -> Tensor:
    """Return the modes of a Gaussian process over the knots, ``(knot, mode)``."""
    places = torch.arange(knots, dtype=torch.float64)
    return _modes(torch.exp(-((places[:, None] - places) ** 2) / (2 * length**2)))


def _modes(covariance: Tensor) -> Tensor:
    """Return L of ``covariance = L Lᵀ``, without the smallest modes."""
    values, vectors = torch.linalg.eigh(covariance)
    kept = values > SMALLEST_MODE * values.max()
    return vectors[:, kept] * values[kept].sqrt()
