"""The Levenberg–Marquardt method, in batches.

A batch of trajectories costs little more than one. A step therefore tries several dampings at once,
and the fits of many sets of candidates share one Jacobian (chord steps).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem, NormalEquations

# Dampings, in units of the curvature of each unknown. One run tries all dampings of a rung. If none
# of them lowers F, the next rung follows.
LADDER = ((0.0, 0.1, 3.0), (30.0, 300.0, 3000.0))
# Growth factor of the horizon; steps and tolerance at each horizon.
GROWTH, GROWING_STEPS, GROWING_TOLERANCE = 1.4, 3, 1e-2
# A tolerance from which on F alone matters, and not how well the unknowns are determined; and the
# relative deviation from the prediction of the linearised problem up to which F is at its minimum.
LOOSE, PREDICTED = 0.02, 1e-3
# Largest number of rounds.
ROUNDS = 4
# Largest number of further steps with one Jacobian.
CHORDS = 3
# A chord fit that needs more damping than this is stopped.
MOST_DAMPED = 10.0


@dataclass(frozen=True)
class FitResult:
    """The result of a fit.

    Attributes:
        phi: the unknowns, ``(unknown,)``.
        cost: F at ``phi``.
        chi2: the part ``‖W(H S - y)‖²`` of F.
        readings: readings at ``phi``, ``(time, sensor)``.
        converged: whether F is at its minimum, to within the tolerance.
        jacobians: number of Jacobians computed.
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
    bound: float = math.inf,
) -> FitResult:
    """Minimise F with a fresh Jacobian at every step.

    The fit has converged if a step lowers F by little. With a loose tolerance it has also converged
    if further steps with the same Jacobian reach the F that the linearised problem predicts.

    Args:
        objective: F.
        phi: initial unknowns.
        steps: largest number of Jacobians.
        tolerance: share of F that counts as little.
        known: normal equations at ``phi``, under any prior, if they are known already.
        bound: F that the fit has to reach. It is given up if the gain of the last step in each of
            the remaining ones would not suffice.

    Raises:
        OutOfTimeError: the deadline of F is over.
    """
    [cost], (readings, [residuals]) = objective.values(phi[None])
    fitted = FitResult(phi, float(cost), float(residuals.square().sum()), readings[0], False, 0)
    while fitted.jacobians < steps and not fitted.converged:
        objective.deadline.check()
        if known is None or fitted.jacobians:
            normal = objective.linearise(fitted.phi, fitted.readings, objective.deadline)
        else:
            normal = known.with_precision(objective.precision)
        if not normal.is_finite:
            break
        lower = _step(objective, normal, fitted, LADDER)
        converged = fitted.cost - lower.cost < tolerance * fitted.cost
        if not converged:
            lower = _chord_steps(objective, normal, lower, tolerance)
            if tolerance >= LOOSE:
                converged = abs(lower.cost - normal.minimum()) < PREDICTED * lower.cost
        gain = fitted.cost - lower.cost
        fitted = replace(lower, converged=converged, jacobians=fitted.jacobians + 1)
        if fitted.cost - gain * (steps - fitted.jacobians) > bound:
            break
    return fitted


def minimise_in_rounds(
    objective: LeastSquaresProblem, phi: Tensor, steps: int, tolerance: float, least_gain: float
) -> FitResult:
    """Minimise F in rounds, as long as each round lowers F by enough.

    A fit of a start, a coefficient and a window may have to follow a long curved valley.

    Args:
        objective: F.
        phi: initial unknowns.
        steps: largest number of Jacobians in a round.
        tolerance: see :func:`minimise`.
        least_gain: a round that lowers F by no more than this is the last.
    """
    fitted = minimise(objective, phi, steps, tolerance)
    for _ in range(ROUNDS - 1):
        if fitted.converged:
            break
        before, fitted = fitted, minimise(objective, fitted.phi, steps, tolerance)
        if not before.cost - fitted.cost > least_gain:
            break
    return fitted


def minimise_growing_horizon(
    objective: LeastSquaresProblem,
    phi: Tensor,
    samples: int,
    growth: float = GROWTH,
    steps: int = GROWING_STEPS,
) -> Tensor:
    """Return the unknowns of the last of :func:`growing_horizon_fits`."""
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
    """Yield fits over growing horizons; the last horizon is the whole record.

    Args:
        objective: F over the whole record.
        phi: initial unknowns.
        samples: initial horizon; the first fit has a longer one.
        growth: growth factor of the horizon.
        steps: largest number of Jacobians at each horizon.
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
    """Repeat steps with the same Jacobian while they lower F: a run costs a tenth of a Jacobian."""
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
    """Return the result of the step with the best damping; the same point if none lowers F."""
    current = objective.residuals(fitted.readings)
    for rung in ladder:
        rows = fitted.phi.expand(len(rung), -1)
        residuals = current.expand(len(rung), -1)
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
        converged: whether the fit has ended within the steps, ``(set,)``.
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
    margin: float,
) -> Refits:
    """Minimise F over many sets of unknowns at once, with one Jacobian for all.

    Each step costs one batched run. If a step does not lower F, the damping of its row is
    multiplied by ten.

    Args:
        objective: F.
        normal: normal equations at a point near all rows.
        phi: initial unknowns of each row.
        free: the free unknowns of each row.
        steps: largest number of runs.
        tolerance: a row has converged if a step lowers its F by less than this.
        margin: a row is given up if the same gain once more would leave its F above the best by
            more than this.
    """
    damping = torch.zeros(len(phi), dtype=torch.float64)
    cost, (_, residuals) = objective.values(phi)
    done = torch.zeros(len(phi), dtype=torch.bool)
    for _ in range(steps):
        rows = torch.nonzero(~done).flatten()
        if not len(rows) or objective.deadline.is_over:
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
        done[rows] |= better & (cost[rows] - gain > cost.min() + margin)
        damping[rows] = torch.where(
            better, damping[rows] / 10, torch.clamp(damping[rows] * 10, min=0.1)
        )
    return Refits(phi, cost, done)
