"""What a law leaves unexplained: a free forcing, as large as the evidence allows.

Of all models it can imitate any other, and so it says two things: how good a law could be at
best, and near which trajectory to look for one (docs/method.md#free-forcing).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import torch
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem, NormalEquations
from dashred.inference.fit.levenberg_marquardt import minimise, minimise_growing_horizon
from dashred.inference.forward.forcing_block import ForcingBlock
from dashred.physics.forcing_basis import ForcingBasis

# Of a forcing: along each axis, by how many there are, for every cell is a column of the Jacobian;
# and in time.
CELLS, KNOTS = (1, 12, 4), 13
# Prior std of an amplitude, as shares of the equation's own tendency; none at all first.
LEVELS = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0)
# Stands for none: an amplitude of this share is too small for anything.
NONE = 1e-6
ROUNDS, STEPS, TOLERANCE = 3, 2, 0.01
# A forcing that leaves so many times the noise has lost the trajectory.
LOST = 2.0
# Then it grows anew from the mean of the start: from a few samples, by small steps, under so many
# times the noise, for between its cells and knots a forcing is not that of the truth.
BEGIN, GROWTH, GROWING_STEPS, COARSE = 6, 1.15, 5, 3.0
# The smallest forcing that follows the recording does: a large one may carry the trajectory away.
GROWN = (0.03, 0.3)
# Of the largest entry of a matrix, what rounding may make of its smallest eigenvalue.
ROUNDING = 1e-12


@dataclass(frozen=True)
class FreeForcing:
    """A forcing that was fitted together with the start.

    Attributes:
        objective: F, in the start, the law and the amplitudes.
        block: the forcing, with its place among the unknowns.
        phi: its minimum, ``(unknown,)``.
        cost: F there.
        normal: F linearised there: several questions are put to it, and it is dear.
        levels: chosen prior std of each equation's amplitudes, as a share of its tendency.
        equations: those that may be forced.
    """

    objective: LeastSquaresProblem
    block: ForcingBlock
    phi: Tensor
    cost: float
    normal: NormalEquations
    levels: tuple[float, ...]
    equations: tuple[int, ...]

    @property
    def evidence(self) -> float:
        """``-2 ln`` of the probability of the recording, up to a constant.

        Over all levels, none preferred: the best of many would be found evident by chance.
        """
        choices = _choices(self.equations, len(self.block.size))
        found = [_with_levels(self.normal, self.block, levels) for levels in choices]
        least = min(found)
        return least - 2 * math.log(sum(math.exp((least - v) / 2) for v in found) / len(found))

    @property
    def amplitudes(self) -> Tensor:
        """Return a, ``(equation, cell, knot)``."""
        return self.block.amplitudes(self.phi[-self.block.count :])[0]


def evidence(normal: NormalEquations, index: Sequence[int]) -> float:
    """Return ``-2 ln p(y)`` of a linearised model with some unknowns, up to a constant.

    ``min F + ln det(JᵀJ + P) - ln det P`` (Laplace).
    """
    chosen = list(index)
    hessian = normal.hessian[chosen][:, chosen]
    precision = normal.precision[chosen]
    goal = normal.jacobian[:, chosen].T @ normal.target
    size = precision.sqrt()
    scaled = hessian / size[:, None] / size
    factor, failed = torch.linalg.cholesky_ex(scaled)
    if failed:
        # Where a trajectory is about to blow up, the rounding of its columns drowns the prior.
        room = ROUNDING * scaled.diagonal().max() * torch.eye(len(scaled), dtype=scaled.dtype)
        factor = torch.linalg.cholesky(scaled + room)
    solved = torch.linalg.solve_triangular(factor, (goal / size)[:, None], upper=False)
    least = float(normal.target.square().sum() - solved.square().sum())
    return least + 2 * float(factor.diagonal().log().sum())


def fit_free_forcing(
    objective: LeastSquaresProblem,
    phi: Tensor,
    block: ForcingBlock,
    equations: Sequence[int],
) -> tuple[FreeForcing, float]:
    """Fit a forcing of some equations, its size in each by the evidence.

    Args:
        objective: F of a law, or of none, over the whole record.
        phi: a fit of start and law, ``(unknown,)``.
        block: the forcing.
        equations: those that are forced; of the others the forcing is none.

    Returns:
        the forcing, and the evidence without one.
    """
    driven = replace(objective.forward_model, forcing=block)
    whole = objective.with_unknowns(driven, _stds(block, LEVELS[-1:] * len(block.size)))
    begin = torch.cat([phi, torch.zeros(block.count, dtype=torch.float64)])
    first = whole.linearise(begin)
    without = evidence(first, range(len(phi)))
    found = _forced(whole, block, begin, equations, first)
    return (found if not _lost(found) else _grown(whole, begin, found)), without


def _grown(whole: LeastSquaresProblem, begin: Tensor, lost: FreeForcing) -> FreeForcing:
    """Return a forcing that was fitted anew from the first samples, if that leaves less."""
    block, found = lost.block, lost
    begin = begin.clone()
    begin[: whole.modes] = 0.0
    for level in GROWN:
        loose = replace(
            _as_large(whole, block, (level,) * len(block.size)), noise=whole.noise.scaled(COARSE)
        )
        phi = minimise_growing_horizon(loose, begin, BEGIN, GROWTH, GROWING_STEPS)
        grown = _forced(whole, block, phi, lost.equations, whole.linearise(phi))
        found = min(found, grown, key=lambda forced: forced.cost)
        if not _lost(found):
            break
    return found


def _forced(
    objective: LeastSquaresProblem,
    block: ForcingBlock,
    phi: Tensor,
    equations: Sequence[int],
    normal: NormalEquations,
) -> FreeForcing:
    """Fit start, law and forcing from where they are, the forcing's size by the evidence.

    Its Jacobian is the dearest of all: none is made twice.

    Args:
        objective: F, in all of them.
        block: the forcing.
        phi: where they are.
        equations: those that are forced.
        normal: F linearised there.
    """
    levels: tuple[float, ...] = ()
    for _ in range(ROUNDS):
        before, levels = levels, _best_levels(normal, block, equations)
        objective = _as_large(objective, block, levels)
        if not any(levels):
            break
        fitted = minimise(objective, phi, STEPS, TOLERANCE, normal)
        phi = fitted.phi
        normal = objective.linearise(phi, fitted.readings)
        if levels == before and fitted.converged:
            break
    normal = replace(normal, precision=objective.precision)
    [cost], _ = objective.values(phi[None])
    return FreeForcing(objective, block, phi, float(cost), normal, levels, tuple(equations))


def _lost(forced: FreeForcing) -> bool:
    """Tell whether a forcing, as large as it may be, leaves far more than noise at the sensors.

    At all but one: that may be at fault.
    """
    objective, normal = forced.objective, forced.normal
    left = normal.residuals.reshape(objective.recorded.shape).square().sum(dim=0)
    seen = objective.noise.available.sum(dim=0)
    others = torch.ones(len(left), dtype=torch.bool)
    others[(left / seen.clamp(min=1)).argmax()] = len(left) == 1
    ratio = (left[others].sum() / seen[others].sum().clamp(min=1)).sqrt()
    # Of a trajectory that blows up the residuals say nothing.
    return not normal.is_finite or float(ratio) > LOST


def force(objective: LeastSquaresProblem, phi: Tensor, size: Tensor) -> tuple[FreeForcing, float]:
    """Return a free forcing on top of a law, and by how much the evidence is for it.

    Args:
        objective: F of a law, or of none.
        phi: its minimum.
        size: rms of each equation's own tendency, ``(equation,)``.
    """
    forward_model = objective.forward_model
    system = forward_model.simulator.system
    basis = ForcingBasis.over(system, forward_model.times, CELLS[len(system.axes)], KNOTS)
    block = ForcingBlock(basis, size)
    forced, without = fit_free_forcing(objective, phi, block, range(len(size)))
    return forced, without - forced.evidence


def _best_levels(
    normal: NormalEquations, block: ForcingBlock, equations: Sequence[int]
) -> tuple[float, ...]:
    """Return the levels with the best evidence."""
    choices = _choices(equations, len(block.size))
    return min(choices, key=lambda levels: _with_levels(normal, block, levels))


def _choices(equations: Sequence[int], fields: int) -> list[tuple[float, ...]]:
    """Return all levels that the equations may have."""
    return list(product(*(LEVELS if e in equations else LEVELS[:1] for e in range(fields))))


def _with_levels(normal: NormalEquations, block: ForcingBlock, levels: tuple[float, ...]) -> float:
    """Return the evidence of a forcing of some levels."""
    precision = torch.cat([normal.precision[: -block.count], _stds(block, levels) ** -2])
    return evidence(replace(normal, precision=precision), range(len(precision)))


def _as_large(
    objective: LeastSquaresProblem, block: ForcingBlock, levels: tuple[float, ...]
) -> LeastSquaresProblem:
    """Return F of a forcing of some levels."""
    stds = torch.cat([objective.prior_std[: -block.count], _stds(block, levels)])
    return replace(objective, prior_std=stds)


def _stds(block: ForcingBlock, levels: Sequence[float]) -> Tensor:
    shares = torch.tensor([max(level, NONE) for level in levels], dtype=torch.float64)
    return block.by_amplitude(shares * block.size)
