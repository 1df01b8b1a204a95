"""Repeat a fit that began at a first guess with the prior of the start.

A first guess from the recording uses the first samples twice. Its error in unobserved directions
may bias the law, and it cannot show that the start is outside the prior.
"""

from __future__ import annotations

import torch
from torch import Tensor

from dashred.core.budget import OutOfTimeError
from dashred.core.progress import Report
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import FitResult, minimise
from dashred.inference.fit.selection.stepwise_selection import Selection, select
from dashred.inference.initial_state.start_models import StartModel

STEPS, TOLERANCE = 10, 1e-4
# The fit with the prior is accepted if its misfit is at most this many times the misfit before. A
# start far from the mean of the prior has a slightly larger misfit. The bound is wider for the
# simulator without a law, because its misfit is not noise. It is tighter for a law, because a law
# could compensate a wrong start.
MAX_RATIO, MAX_LAW_RATIO = 1.3, 1.1


def fit_near_prior(
    prior: StartModel, objective: LeastSquaresProblem, phi: Tensor, max_ratio: float = MAX_RATIO
) -> tuple[LeastSquaresProblem, FitResult] | None:
    """Return the fit with the prior of the start; None if it does not reach the fitted start.

    Args:
        prior: prior of the start, which does not use the recording.
        objective: least-squares problem with a first guess.
        phi: minimum of this problem, ``(unknown,)``.
        max_ratio: largest accepted ratio of the misfits with the prior and with the first guess.
    """
    if objective.forward_model.start is prior:
        return None
    z, xi = objective.split(phi)
    with_prior = objective.with_start(prior)
    initial = objective.forward_model.move_to(prior, z)
    fitted = minimise(with_prior, torch.cat([initial, xi]), STEPS, TOLERANCE)
    _, trials = objective.values(phi[None])
    before = float(trials.residuals.square().sum())
    return (with_prior, fitted) if fitted.chi2 < max_ratio * before else None


def select_near_prior(
    prior: StartModel, selection: Selection, count: int, report: Report
) -> Selection:
    """Select the terms again with the prior of the start, if the best law reaches its fitted start.

    Without time for it the selection stays.

    Args:
        prior: prior of the start, which does not use the recording.
        selection: laws that were fitted with a first guess.
        count: number of the best sets that are refitted first.
        report: progress.
    """
    best, objective = selection.tried[0], selection.objective
    if not best.members:
        return selection
    law = objective.subset(best.members)
    phi = best.phi[objective.indices(best.members)]
    try:
        refit = fit_near_prior(prior, law, phi, MAX_LAW_RATIO)
    except OutOfTimeError:
        return selection
    if refit is None:
        return selection
    with_prior = objective.with_start(prior)
    initial = with_prior.embed(refit[1].phi, best.members)
    sets = [tried.members for tried in selection.tried[:count]]
    return select(with_prior, initial, sets, report)
