"""Ask of a fit about a first guess whether it stands about the prior of the start, too.

A first guess that was made from the recording uses the first samples twice: where it is off in what
no sensor reads, it leaves its error to the law, and it cannot tell a start outside of the prior.
"""

from __future__ import annotations

import torch
from torch import Tensor

from dashred.core.progress import Report
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import FitResult, minimise
from dashred.inference.fit.stepwise_selection import Selection, select
from dashred.inference.initial_state.start_models import StartModel, project_state

STEPS, TOLERANCE = 10, 1e-4
# A start that the prior reaches fits as well about it; far out, its prior holds it back a little.
# Of the simulator as it is, whose misfit is no noise, and of a law, which would bend to its start.
NO_WORSE, LAW_NO_WORSE = 1.3, 1.1


def fit_near_prior(
    prior: StartModel, objective: LeastSquaresProblem, phi: Tensor, worse: float = NO_WORSE
) -> tuple[LeastSquaresProblem, FitResult] | None:
    """Return the same fit about the prior; None if that does not reach the start that was found.

    Args:
        prior: what is known of the start without the recording.
        objective: F about a first guess.
        phi: its minimum, ``(unknown,)``.
        worse: how much larger its misfit may be about the prior.
    """
    if objective.forward_model.start is prior:
        return None
    z, xi = objective.split(phi)
    mine = objective.with_start(prior)
    begin = project_state(prior, objective.forward_model.start.start(z[None])[0])
    found = minimise(mine, torch.cat([begin, xi]), STEPS, TOLERANCE)
    _, trials = objective.values(phi[None])
    before = float(trials.residuals.square().sum())
    return (mine, found) if found.chi2 < worse * before else None


def select_near_prior(
    prior: StartModel, selection: Selection, kept: int, report: Report
) -> Selection:
    """Select once more about the prior, if the best law reaches the start that was found from it.

    Args:
        prior: what is known of the start without the recording.
        selection: the laws about a first guess.
        kept: how many of the best sets are refitted first.
        report: progress.
    """
    best, objective = selection.tried[0], selection.objective
    if not best.members:
        return selection
    law = objective.subset(best.members)
    phi = best.phi[objective.indices(best.members)]
    found = fit_near_prior(prior, law, phi, LAW_NO_WORSE)
    if found is None:
        return selection
    whole = objective.with_start(prior)
    begin = whole.embed(found[1].phi, best.members)
    sets = [tried.members for tried in selection.tried[:kept]]
    return select(whole, begin, sets, report)
