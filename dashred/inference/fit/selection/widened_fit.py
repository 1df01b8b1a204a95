"""Fit a law with a narrow prior that the evidence widens for a few candidates."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import FitResult, minimise
from dashred.inference.fit.selection.prior_widths import widen_by_evidence, width_penalty
from dashred.inference.fit.selection.subset_search import ProfiledProblem

# How often the widths are chosen again at a fit with the last ones.
ROUNDS = 3


@dataclass(frozen=True)
class WidenedFit:
    """A fit of all candidates, with prior stds that the evidence chose.

    Attributes:
        fitted: the fit.
        prior_std: prior std of each coefficient, ``(coefficient,)``.
        cost: F, and the penalty of the widened candidates.
    """

    fitted: FitResult
    prior_std: Tensor
    cost: float


def fit_widened(
    objective: LeastSquaresProblem, narrow: Tensor, phi: Tensor, steps: int, tolerance: float
) -> tuple[WidenedFit | None, int]:
    """Return the best fit with widened priors, and the number of Jacobians that it took.

    The evidence is that of the problem linearised at the last fit, so the widths are chosen again
    at their own fit until they stay.

    Args:
        objective: F with the present prior.
        narrow: the narrowest prior stds, ``(coefficient,)``.
        phi: a fit with the present prior, ``(unknown,)``.
        steps: largest number of Jacobians of each fit.
        tolerance: see :func:`.levenberg_marquardt.minimise`.

    Returns:
        The fit; None if the evidence changes no width, or if the run at ``phi`` blows up.

    Raises:
        OutOfTimeError: the deadline of F is over.
    """
    limits = [candidate.limit for candidate in objective.forward_model.law.candidates]
    best: WidenedFit | None = None
    jacobians = 0
    for _ in range(ROUNDS if limits else 0):
        normal = objective.linearise(phi)
        jacobians += 1
        if not normal.is_finite:
            break
        problem = ProfiledProblem.from_normal_equations(normal, objective.modes)
        chosen = widen_by_evidence(problem, narrow, torch.tensor(limits, dtype=torch.float64))
        if torch.equal(chosen, objective.prior_std):
            break
        objective = replace(objective, prior_std=chosen)
        fitted = minimise(objective, phi, steps, tolerance, normal)
        phi, jacobians = fitted.phi, jacobians + max(0, fitted.jacobians - 1)
        cost = fitted.cost + width_penalty(len(limits)) * int((chosen > narrow).sum())
        if best is None or cost < best.cost:
            best = WidenedFit(fitted, chosen, cost)
    return best, jacobians
