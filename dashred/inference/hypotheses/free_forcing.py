"""A free forcing: an arbitrary force on the equations, with amplitudes chosen by the evidence.

A free forcing can imitate any law. It therefore shows how well a law could fit at best, and near
which trajectory to search for one (docs/method.md#free-forcing).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem, NormalEquations
from dashred.inference.fit.levenberg_marquardt import minimise, minimise_growing_horizon
from dashred.inference.forward.forcing_block import ForcingBlock
from dashred.inference.hypotheses.forcing_levels import (
    LEVELS,
    STRONG_LEVELS,
    best_levels,
    evidence,
    evidence_of_levels,
    level_combinations,
    prior_stds,
)
from dashred.physics.forcing_basis import ForcingBasis

# Number of cells along each axis, by the number of axes, and of knots in time. Every cell and knot
# is a column of the Jacobian.
CELLS, KNOTS = (1, 12, 4), 13
ROUNDS, STEPS, TOLERANCE = 3, 2, 0.01
# A forcing with larger residuals, as a multiple of the noise, has lost the recording.
MAX_NOISE_RATIO = 2.0
# It is then refitted over a growing horizon from the mean of the initial state. The noise is
# multiplied by NOISE_FACTOR, because a forcing is coarse in space and time.
FIRST_SAMPLES, GROWTH, GROWING_STEPS, NOISE_FACTOR = 6, 1.15, 5, 3.0
# Levels of such a refit. The smallest that follows the recording is used: a large forcing may drive
# the trajectory away.
GROWING_LEVELS = (0.03, 0.3)


@dataclass(frozen=True)
class FreeForcing:
    """A forcing that was fitted together with the initial state and the law.

    Attributes:
        objective: F of the initial state, the law and the amplitudes.
        block: the forcing as a block of unknowns.
        phi: the minimum of F, ``(unknown,)``.
        cost: F at the minimum.
        normal: F linearised at the minimum; kept because it is expensive and used several times.
        levels: chosen prior std of each equation's amplitudes, as a share of its tendency.
        equations: indices of the equations that may be forced.
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

        It is averaged over all levels, because the best of many does well by chance.
        """
        choices = level_combinations(self.equations, len(self.block.size))
        values = [evidence_of_levels(self.normal, self.block, levels) for levels in choices]
        least = min(values)
        return least - 2 * math.log(sum(math.exp((least - v) / 2) for v in values) / len(values))

    @property
    def amplitudes(self) -> Tensor:
        """The amplitudes of the forcing, ``(equation, cell, knot)``."""
        return self.block.amplitudes(self.phi[-self.block.count :])[0]


def fit_forcing_block(
    objective: LeastSquaresProblem,
    phi: Tensor,
    block: ForcingBlock,
    equations: Sequence[int],
) -> tuple[FreeForcing, float]:
    """Fit a forcing of some equations; the evidence chooses its level in each.

    Args:
        objective: F of the initial state and a law, if any, over the whole record.
        phi: a fit of these, ``(unknown,)``.
        block: the forcing.
        equations: indices of the equations that are forced.

    Returns:
        The forcing, and the evidence without a forcing.

    Raises:
        OutOfTimeError: the deadline of F is over.
    """
    whole, begin = _forced_problem(objective, phi, block)
    first = whole.linearise(begin)
    without = evidence(first, range(len(phi)))
    forcing = _fit_levels(whole, block, begin, equations, first)
    if _has_lost_recording(forcing):
        forcing = _refit_growing_horizon(whole, begin, forcing)
    return forcing, without


def fit_forcing_nearby(
    objective: LeastSquaresProblem, phi: Tensor, tendency_rms: Tensor
) -> FreeForcing | None:
    """Fit a free forcing; None if it loses the recording. Arguments as in :func:`fit_free_forcing`.

    Raises:
        OutOfTimeError: the deadline of F is over.
    """
    block = _coarse_block(objective, tendency_rms)
    whole, begin = _forced_problem(objective, phi, block)
    equations = range(len(tendency_rms))
    forcing = _fit_levels(whole, block, begin, equations, whole.linearise(begin))
    if _has_lost_recording(forcing) and LEVELS[-1] in forcing.levels:
        strong = LEVELS + STRONG_LEVELS
        forcing = _fit_levels(whole, block, forcing.phi, equations, forcing.normal, strong)
    return None if _has_lost_recording(forcing) else forcing


def _forced_problem(
    objective: LeastSquaresProblem, phi: Tensor, block: ForcingBlock
) -> tuple[LeastSquaresProblem, Tensor]:
    """Return F with a forcing, and the point without one."""
    objective.deadline.check()
    forced_model = replace(objective.forward_model, forcing=block)
    whole = objective.with_unknowns(forced_model, prior_stds(block, LEVELS[-1:] * len(block.size)))
    return whole, torch.cat([phi, torch.zeros(block.count, dtype=torch.float64)])


def _coarse_block(objective: LeastSquaresProblem, tendency_rms: Tensor) -> ForcingBlock:
    model = objective.forward_model
    system = model.simulator.system
    basis = ForcingBasis.over(system, model.times, CELLS[len(system.axes)], KNOTS)
    return ForcingBlock(basis, tendency_rms)


def _refit_growing_horizon(
    whole: LeastSquaresProblem, begin: Tensor, previous: FreeForcing
) -> FreeForcing:
    """Refit a forcing over a growing horizon; return it if F decreases, else the previous one."""
    block, best = previous.block, previous
    begin = begin.clone()
    begin[: whole.modes] = 0.0
    for level in GROWING_LEVELS:
        problem = _with_levels(whole, block, (level,) * len(block.size))
        noisier = replace(problem, noise=whole.noise.scaled(NOISE_FACTOR))
        phi = minimise_growing_horizon(noisier, begin, FIRST_SAMPLES, GROWTH, GROWING_STEPS)
        grown = _fit_levels(whole, block, phi, previous.equations, whole.linearise(phi))
        best = min(best, grown, key=lambda forcing: forcing.cost)
        if not _has_lost_recording(best):
            break
    return best


def _fit_levels(
    objective: LeastSquaresProblem,
    block: ForcingBlock,
    phi: Tensor,
    equations: Sequence[int],
    normal: NormalEquations,
    choices: Sequence[float] = LEVELS,
) -> FreeForcing:
    """Fit initial state, law and forcing; the evidence chooses the levels of the forcing.

    The Jacobian is expensive, so it is never computed twice at the same point.

    Args:
        objective: F of all unknowns.
        block: the forcing.
        phi: unknowns at which the fit begins.
        equations: indices of the equations that are forced.
        normal: F linearised at ``phi``.
        choices: levels to choose from.
    """
    levels: tuple[float, ...] = ()
    for _ in range(ROUNDS):
        before, levels = levels, best_levels(normal, block, equations, choices)
        objective = _with_levels(objective, block, levels)
        if not any(levels):
            break
        fitted = minimise(objective, phi, STEPS, TOLERANCE, normal)
        phi = fitted.phi
        normal = objective.linearise(phi, fitted.readings)
        if levels == before and fitted.converged:
            break
    normal = normal.with_precision(objective.precision)
    [cost], _ = objective.values(phi[None])
    return FreeForcing(objective, block, phi, float(cost), normal, levels, tuple(equations))


def _has_lost_recording(forcing: FreeForcing) -> bool:
    """Tell whether a forcing leaves far more than noise at the sensors.

    The worst sensor is not counted, because it may be faulty.
    """
    objective, normal = forcing.objective, forcing.normal
    squares = normal.residuals.reshape(objective.recorded.shape).square().sum(dim=0)
    seen = objective.noise.available.sum(dim=0)
    is_other = torch.ones(len(squares), dtype=torch.bool)
    is_other[(squares / seen.clamp(min=1)).argmax()] = len(squares) == 1
    ratio = (squares[is_other].sum() / seen[is_other].sum().clamp(min=1)).sqrt()
    # The residuals of a trajectory that blows up mean nothing.
    return not normal.is_finite or float(ratio) > MAX_NOISE_RATIO


def fit_free_forcing(
    objective: LeastSquaresProblem, phi: Tensor, tendency_rms: Tensor
) -> tuple[FreeForcing, float]:
    """Fit a free forcing on top of a law, and return it with the evidence that it gains.

    Args:
        objective: F of the initial state and a law, if any.
        phi: its minimum, ``(unknown,)``.
        tendency_rms: rms of each equation's own tendency, ``(equation,)``.
    """
    block = _coarse_block(objective, tendency_rms)
    forcing, without = fit_forcing_block(objective, phi, block, range(len(tendency_rms)))
    return forcing, without - forcing.evidence


def _with_levels(
    objective: LeastSquaresProblem, block: ForcingBlock, levels: tuple[float, ...]
) -> LeastSquaresProblem:
    """Return F of a forcing with these levels."""
    stds = torch.cat([objective.prior_std[: -block.count], prior_stds(block, levels)])
    return replace(objective, prior_std=stds)
