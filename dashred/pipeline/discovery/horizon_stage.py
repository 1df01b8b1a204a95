"""Walk the horizon: from which first guess, how far, and farther with the law that was found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch

from dashred.core.progress import Report
from dashred.inference.fit.first_window import first_samples
from dashred.inference.fit.growing_horizon import HorizonFit, grow_horizon
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.stepwise_selection import Selection, select
from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.simulator import Simulator
from dashred.pipeline.discovery.first_guess_stage import FittedGuess
from dashred.pipeline.discovery.objectives import build_least_squares
from dashred.pipeline.problem import Problem

# Of the laws that were tried, those that are tried again over more of the record.
TRIED_AGAIN = 6


def fit_from_first_guesses(
    problem: Problem,
    simulator: Simulator,
    candidates: Sequence[Candidate],
    guesses: Sequence[FittedGuess],
    report: Report,
) -> tuple[FittedGuess, HorizonFit]:
    """Walk from the best first guess; where it gets lost, from the next; keep who came farthest.

    Args:
        problem: the recording, and how far to walk.
        simulator: with all candidates in reach, as fine as walking needs.
        candidates: of the model error.
        guesses: of the start, the best first.
        report: progress.
    """
    settings = problem.config.discovery
    limits = torch.tensor([c.limit for c in candidates], dtype=torch.float64)
    best: tuple[FittedGuess, HorizonFit] | None = None
    for guess in guesses:
        objective = build_least_squares(problem, simulator, guess.start, candidates, settings.tight)
        tight = torch.minimum(objective.prior_std, limits)
        objective = replace(objective, prior_std=tight)
        begin, samples = objective.embed(guess.z, []), first_samples(objective)
        walked = grow_horizon(objective, begin, samples, settings.walking, report)
        if best is None or walked.samples > best[1].samples:
            best = guess, walked
        if walked.is_complete:
            break
    assert best is not None
    return best


def with_noise_after(objective: LeastSquaresProblem, walked: HorizonFit) -> LeastSquaresProblem:
    """Return F with the noise that the residuals of the walk speak for.

    Args:
        objective: F of all candidates over the whole record.
        walked: how far, and with which of them.
    """
    part = objective.truncate(walked.samples)
    mine = part.subset(walked.members)
    normal = mine.linearise(walked.phi[part.indices(walked.members)], walked.readings)
    found = part.estimate_noise(
        walked.readings, normal.effective_parameters(range(len(normal.phi)))
    )
    return replace(objective, noise=replace(found, available=objective.noise.available))


def walk_on(
    objective: LeastSquaresProblem,
    walked: HorizonFit,
    selection: Selection,
    proposals: list[tuple[int, ...]],
    report: Report,
) -> tuple[HorizonFit, Selection]:
    """Walk on with the law that was found so far, and select once more where that leads.

    All candidates together may have lost a trajectory that the right few can follow.

    Args:
        objective: F of all candidates over the whole record.
        walked: how far they came together.
        selection: the laws of so much of the record.
        proposals: sets of candidates that are tried in any case.
        report: progress.
    """
    best = selection.tried[0]
    mine = objective.subset(best.members)
    begin = best.phi[objective.indices(best.members)]
    further = grow_horizon(mine, begin, walked.samples, len(best.members), report)
    if further.samples == walked.samples:
        return walked, selection
    further = replace(
        further,
        phi=objective.embed(further.phi, best.members),
        members=best.members,
        levels=[*walked.levels, *further.levels[1:]],
    )
    sets = [*proposals, *(tried.members for tried in selection.tried[:TRIED_AGAIN])]
    return further, select(objective.truncate(further.samples), further.phi, sets, report)
