"""Extend the horizon: the part of the record that the fit has reached."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import product

import torch

from dashred.core.budget import Deadline
from dashred.core.progress import Report
from dashred.inference.fit.first_window import first_samples
from dashred.inference.fit.growing_horizon import HorizonFit, fit_first_horizon, grow_horizon
from dashred.inference.fit.horizon_state import HorizonState
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.selection.stepwise_selection import Selection, select
from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.simulator import Simulator
from dashred.pipeline.discovery.first_guess_stage import FittedGuess
from dashred.pipeline.discovery.least_squares import build_least_squares
from dashred.pipeline.problem import Problem

# Number of the best laws that are selected from again over a longer part of the record.
LAWS_AGAIN = 6
# Share of the first samples that is fitted if no first guess explains all of them.
FEWER = 0.5


def fit_from_first_guesses(
    problem: Problem,
    simulator: Simulator,
    candidates: Sequence[Candidate],
    guesses: Sequence[FittedGuess],
    report: Report,
) -> tuple[FittedGuess, HorizonFit]:
    """Extend the horizon from each first guess until one of them reaches the end of the record.

    A first guess with few modes may have a small error and still be unable to fit the first samples
    to the noise, whatever the law. Such a guess is tried after the others. If no guess can, fewer
    first samples are fitted, whose misfit has fewer false minima.

    Args:
        problem: recording and settings.
        simulator: simulator with all candidates, at the resolution for this stage.
        candidates: terms that may be missing.
        guesses: fitted first guesses, the best first.
        report: progress.

    Returns:
        The first guess with the longest horizon, and its fit.
    """
    settings = problem.config.discovery
    limits = torch.tensor([c.limit for c in candidates], dtype=torch.float64)
    deadline = problem.deadline("grow the horizon")

    def fit_first(guess: FittedGuess, share: float) -> HorizonState:
        objective = build_least_squares(problem, simulator, guess.start, candidates, settings.tight)
        tight = torch.minimum(objective.prior_std, limits)
        objective = replace(objective, prior_std=tight, deadline=deadline)
        samples = math.ceil(share * first_samples(objective))
        return fit_first_horizon(objective, objective.embed(guess.z, []), samples, settings.walking)

    best: tuple[FittedGuess, HorizonFit] | None = None
    for guess, first in explaining_guesses_first(guesses, fit_first, deadline):
        horizon = grow_horizon(first, settings.walking, report)
        if best is None or horizon.samples > best[1].samples:
            best = guess, horizon
        if horizon.is_complete or deadline.is_over:
            break
    assert best is not None
    if deadline.is_over and not best[1].is_complete:
        problem.budget.leave_out("a longer horizon")
    return best


def explaining_guesses_first(
    guesses: Sequence[FittedGuess],
    fit_first: Callable[[FittedGuess, float], HorizonState],
    deadline: Deadline,
) -> Iterator[tuple[FittedGuess, HorizonState]]:
    """Yield guesses and their fits of the first samples; those that explain them come first.

    If none explains them, guesses follow whose fits of fewer samples explain these. In the end come
    the fits of all first samples that did not explain them, by their misfits. A guess is fitted
    when it is needed. After the deadline no further one is fitted while another one is left.

    Args:
        guesses: fitted first guesses, the best first.
        fit_first: fits a share of the first samples from a guess.
        deadline: of the growing horizon.
    """
    others: list[tuple[FittedGuess, HorizonState]] = []
    for share, guess in product((1.0, FEWER), guesses):
        is_needed = share == 1.0 or len(others) == len(guesses)
        if not is_needed or (others and deadline.is_over):
            break
        first = fit_first(guess, share)
        if first.explains_first_samples:
            yield guess, first
        elif share == 1.0:
            others.append((guess, first))
    yield from sorted(others, key=lambda pair: pair[1].misfit_of_first_samples)


def selection_prior(tight: float, weak: float, horizon: HorizonFit) -> float:
    """Return the prior std of the coefficients in the selection, in their natural scales.

    It is the weak one, unless the evidence of the growing horizon needed a wider one: then
    all candidates get it. A prior that is too narrow for the law would prefer several nearly
    proportional terms, which share its coefficient, to the one true term.

    Args:
        tight: prior std while the horizon grows.
        weak: smallest prior std in the selection.
        horizon: fit whose prior may have been widened.
    """
    return max(weak, tight * horizon.widest)


def with_residual_noise(objective: LeastSquaresProblem, horizon: HorizonFit) -> LeastSquaresProblem:
    """Return the least-squares problem with the noise estimated from the residuals of a fit.

    Args:
        objective: problem of all candidates over the whole record.
        horizon: fit up to the horizon.
    """
    part = objective.truncate(horizon.samples)
    fitted = part.subset(horizon.members)
    normal = fitted.linearise(horizon.phi[part.indices(horizon.members)], horizon.readings)
    noise = part.estimate_noise(
        horizon.readings, normal.effective_parameters(range(len(normal.phi)))
    )
    return replace(objective, noise=noise.over(objective.noise))


def extend_horizon(
    objective: LeastSquaresProblem,
    horizon: HorizonFit,
    selection: Selection,
    proposals: list[tuple[int, ...]],
    report: Report,
) -> tuple[HorizonFit, Selection]:
    """Extend the horizon with the best law and select the terms again over the longer record.

    A law with few terms may follow a trajectory that the fit of all candidates could not follow.

    Args:
        objective: problem of all candidates over the whole record.
        horizon: fit of all candidates up to their horizon.
        selection: laws that were selected up to this horizon.
        proposals: sets of candidates that are tried in any case.
        report: progress.
    """
    if objective.deadline.is_over:
        return horizon, selection
    best = selection.tried[0]
    law = objective.subset(best.members)
    initial = best.phi[objective.indices(best.members)]
    count = len(best.members)
    first = fit_first_horizon(law, initial, horizon.samples, count)
    longer = grow_horizon(first, count, report)
    if longer.samples == horizon.samples:
        return horizon, selection
    longer = replace(
        longer,
        phi=objective.embed(longer.phi, best.members),
        members=best.members,
        levels=[*horizon.levels, *longer.levels[1:]],
    )
    sets = [*proposals, *(tried.members for tried in selection.tried[:LAWS_AGAIN])]
    return longer, select(objective.truncate(longer.samples), longer.phi, sets, report)
