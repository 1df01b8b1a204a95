"""Levenberg–Marquardt Gauss–Newton steps in batches.

A run of several trajectories costs little more than one, so a step tries a whole ladder of
dampings at once, and the fits of many sets of candidates share one Jacobian (chord steps).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem, NormalEquations

# One run tries all of a rung; the next, where none of it lowers F. In units of each curvature.
LADDER = ((0.0, 0.1, 3.0), (30.0, 300.0, 3000.0))
# By how much a horizon grows at once, and the steps at each.
GROWTH, GROWING_STEPS, GROWING_TOLERANCE = 1.4, 3, 1e-2
# Rounds of steps at most.
ROUNDS = 4
# Further steps with one Jacobian.
CHORDS = 3
# A chord fit that needs more than this goes nowhere.
MOST_DAMPED = 10.0


@dataclass(frozen=True)
class FitResult:
    """Where a fit has ended.

    Attributes:
        phi: the unknowns, ``(unknown,)``.
        cost: F there.
        chi2: its part ``‖W(H S - y)‖²``.
        readings: ``(time, sensor)``.
        converged: the last step lowered F by less than was asked for.
        jacobians: how many it took.
    """

    phi: Tensor
    cost: float
    chi2: float
    readings: Tensor
    converged: bool
    jacobians: int


def minimise(
    objective: LeastSquaresProblem,
    phi: Float[Tensor, " unknown"],
    steps: int,
    tolerance: float,
    known: NormalEquations | None = None,
) -> FitResult:
    """Minimise F with a fresh Jacobian at every step.

    Args:
        objective: F.
        phi: where to begin.
        steps: Jacobians at most.
        tolerance: a step that lowers F by less than this, relatively, is the last.
        known: F linearised about the beginning, under any prior, where that is known already.
    """
    [cost], (readings, [residuals]) = objective.values(phi[None])
    fitted = FitResult(phi, float(cost), float(residuals.square().sum()), readings[0], False, 0)
    while fitted.jacobians < steps and not fitted.converged:
        if known is None or fitted.jacobians:
            normal = objective.linearise(fitted.phi, fitted.readings)
        else:
            normal = replace(known, precision=objective.precision)
        if not normal.is_finite:
            break
        lower = _step(objective, normal, fitted, LADDER)
        converged = fitted.cost - lower.cost < tolerance * fitted.cost
        if not converged:
            lower = _chord_steps(objective, normal, lower, tolerance)
        fitted = replace(lower, converged=converged, jacobians=fitted.jacobians + 1)
    return fitted


def minimise_in_rounds(
    objective: LeastSquaresProblem, phi: Tensor, steps: int, tolerance: float, worth: float
) -> FitResult:
    """Minimise F in rounds of so many steps, while a round gains what it is worth.

    Between a law's start, its coefficient and its window there may be a long curved valley.

    Args:
        objective: F.
        phi: where to begin.
        steps: of a round, Jacobians at most.
        tolerance: as for :func:`minimise`.
        worth: a round that lowers F by less is the last.
    """
    fitted = minimise(objective, phi, steps, tolerance)
    for _ in range(ROUNDS - 1):
        if fitted.converged:
            break
        before, fitted = fitted, minimise(objective, fitted.phi, steps, tolerance)
        if not before.cost - fitted.cost > worth:
            break
    return fitted


def minimise_growing_horizon(
    objective: LeastSquaresProblem,
    phi: Tensor,
    samples: int,
    growth: float = GROWTH,
    steps: int = GROWING_STEPS,
) -> Tensor:
    """Return a fit of the whole record, however bad, grown from one of its first samples."""
    for fitted in growing_horizon_fits(objective, phi, samples, growth, steps):
        phi = fitted.phi
    return phi


def growing_horizon_fits(
    objective: LeastSquaresProblem,
    phi: Tensor,
    samples: int,
    growth: float = GROWTH,
    steps: int = GROWING_STEPS,
) -> Iterator[FitResult]:
    """Yield fits over longer and longer horizons, the last of them the whole record.

    Args:
        objective: F over the whole record.
        phi: where to begin.
        samples: the horizon before the first.
        growth: of the horizon at once.
        steps: Jacobians at each.
    """
    total = len(objective.recorded)
    while samples < total:
        samples = min(total, max(samples + 1, round(samples * growth)))
        fitted = minimise(objective.truncate(samples), phi, steps, GROWING_TOLERANCE)
        phi = fitted.phi
        yield fitted


def _chord_steps(
    objective: LeastSquaresProblem, normal: NormalEquations, fitted: FitResult, tolerance: float
) -> FitResult:
    """Go on with the same Jacobian while it gains: a run costs a tenth of another."""
    for _ in range(CHORDS):
        lower = _step(objective, normal, fitted, LADDER[:1])
        gain, fitted = fitted.cost - lower.cost, lower
        if gain < tolerance * fitted.cost:
            break
    return fitted


def _step(
    objective: LeastSquaresProblem,
    normal: NormalEquations,
    fitted: FitResult,
    ladder: Sequence[Sequence[float]],
) -> FitResult:
    """Return where the best damping leads; the same place, if none lowers F."""
    here = objective.residuals(fitted.readings)
    for rung in ladder:
        rows = fitted.phi.expand(len(rung), -1)
        residuals = here.expand(len(rung), -1)
        damping = torch.tensor(rung, dtype=torch.float64)
        free = torch.ones(rows.shape, dtype=torch.bool)
        trial = rows + normal.steps(rows, residuals, damping, free)
        costs, trials = objective.values(trial)
        best = int(costs.argmin())
        if float(costs[best]) < fitted.cost:
            chi2 = float(trials.residuals[best].square().sum())
            return replace(
                fitted,
                phi=trial[best],
                cost=float(costs[best]),
                chi2=chi2,
                readings=trials.readings[best],
            )
    return fitted


@dataclass(frozen=True)
class Refits:
    """Fits of many sets of candidates.

    Attributes:
        phi: ``(set, unknown)``; zero for candidates not in the set.
        cost: F, ``(set,)``.
        converged: ``(set,)``.
    """

    phi: Tensor
    cost: Tensor
    converged: Tensor


def chord_refits(
    objective: LeastSquaresProblem,
    normal: NormalEquations,
    phi: Float[Tensor, "set unknown"],
    free: Bool[Tensor, "set unknown"],
    steps: int,
    tolerance: float,
    hopeless: float,
) -> Refits:
    """Minimise F over many sets of unknowns at once, with one Jacobian for all.

    Each step costs one batched run. A row whose step does not lower F is damped ten times more.

    Args:
        objective: F.
        normal: the normal equations about a point near all of them.
        phi: where each begins.
        free: which unknowns each may move.
        steps: runs at most.
        tolerance: a row that gains less than this in F is done, absolutely.
        hopeless: a row that would not come this near to the best, did it gain as much again, is
            given up.
    """
    damping = torch.zeros(len(phi), dtype=torch.float64)
    cost, (_, residuals) = objective.values(phi)
    done = torch.zeros(len(phi), dtype=torch.bool)
    for _ in range(steps):
        rows = torch.nonzero(~done).flatten()
        if not len(rows):
            break
        finite = torch.where(torch.isfinite(residuals[rows]), residuals[rows], 0.0)
        trial = phi[rows] + normal.steps(phi[rows], finite, damping[rows], free[rows])
        costs, (_, found) = objective.values(trial)
        gain = cost[rows] - costs
        better = gain > 0
        phi, cost, residuals = phi.clone(), cost.clone(), residuals.clone()
        phi[rows[better]], cost[rows[better]] = trial[better], costs[better]
        residuals[rows[better]] = found[better]
        # After a damped step a small gain says nothing about the next.
        done[rows] = better & (gain < tolerance) & (damping[rows] < 1)
        done[rows] |= damping[rows] > MOST_DAMPED
        done[rows] |= better & (cost[rows] - gain > cost.min() + hopeless)
        damping[rows] = torch.where(
            better, damping[rows] / 10, torch.clamp(damping[rows] * 10, min=0.1)
        )
    return Refits(phi, cost, done)
