"""Follow a term in a window from the first part of a record to its end, before any law."""

from __future__ import annotations

from dashred.core.budget import OutOfTimeError
from dashred.core.progress import Report
from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import FitResult
from dashred.inference.hypotheses.first_part import FirstPart, follows
from dashred.inference.hypotheses.follow_to_end import STEPS, TOLERANCE, follow_to_end
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from dashred.inference.hypotheses.windows.screening import screen
from dashred.inference.hypotheses.windows.windowed_hypothesis import (
    Hypothesis,
    build_problem,
    first_unknowns,
    fit_trial,
)
from dashred.inference.hypotheses.windows.windowed_laws import (
    fit_screened,
    fit_until_convergence,
    penalty_of,
    predicted_score,
    select_diverse,
)

# Number of hypotheses that are fitted over the first part, and until convergence; the largest
# number with the same term.
TRIALS, FINALISTS, OF_LAW = 8, 3, 2
# A term that acts everywhere, or two, that come so near are left to the search for a law.
MARGIN = 20.0


def find_early_window(
    objective: LeastSquaresProblem, part: FirstPart, global_count: int, report: Report
) -> HypothesisFit | None:
    """Return a term in a window that explains the whole recording, if there is one.

    Args:
        objective: F of all candidates over the whole record; its simulator has windows.
        part: the first part in which something is missing.
        global_count: number of candidates that may act everywhere; these come first.
        report: progress.

    Raises:
        OutOfTimeError: the deadline of F is over.
    """
    first, forced = objective.truncate(part.samples), part.forcing
    states = forced.objective.forward_model.sampled_states(*forced.objective.split(forced.phi))
    windowed = range(len(objective.prior_std))
    screened = screen(first, global_count, windowed, forced, states)
    ranked = sorted(screened, key=lambda each: predicted_score(first, each))
    [best] = ranked[:1]
    everywhere = [each for each in ranked if each.hypothesis.guess is None]
    limit = min(predicted_score(first, each) for each in everywhere) - MARGIN
    if predicted_score(first, best) > limit:
        return None
    local = [each for each in ranked if each.hypothesis.guess is not None]
    z = forced.phi[: objective.modes]
    chosen = select_diverse(local, OF_LAW, TRIALS)
    trials = sorted(fit_screened(first, chosen, z), key=lambda trial: trial.score)[:FINALISTS]
    fits = fit_until_convergence(trials)
    if len(fits) < min(FINALISTS, len(chosen)):
        raise OutOfTimeError
    pairs = zip(trials, fits, strict=True)
    hypothesis, fit = min(
        ((trial.hypothesis, fit) for trial, fit in pairs), key=lambda pair: pair[1].law.score
    )
    report(part.samples / len(objective.recorded), f"{fit.law}, χ²/n {fit.law.chi2:.2f}")
    if not follows(first, fit.law.chi2 * first.noise.count):
        return None
    problem = build_problem(objective, hypothesis)
    last = follow_to_end(problem, fit.phi, part.samples, str(fit.law), report)
    if last is None:
        return None
    score = last.cost + penalty_of(objective, hypothesis)
    if _is_as_good_everywhere(objective, global_count, hypothesis, problem, last, score):
        return None
    return HypothesisFit(build_law(problem, last, score), problem, last.phi)


def _is_as_good_everywhere(
    objective: LeastSquaresProblem,
    global_count: int,
    hypothesis: Hypothesis,
    problem: LeastSquaresProblem,
    fitted: FitResult,
    score: float,
) -> bool:
    """Return whether the terms of a fitted window come near it if they act everywhere.

    The window may have grown until it covers the record.

    Args:
        objective: F of all candidates over the whole record.
        global_count: number of candidates that may act everywhere.
        hypothesis: the window and its terms.
        problem: F of the hypothesis.
        fitted: its fit.
        score: its score.
    """
    members = (*hypothesis.global_terms, *hypothesis.windowed_terms)
    if max(members) >= global_count:
        return False
    everywhere = Hypothesis(tuple(sorted(members)))
    z, xi = problem.split(fitted.phi)
    coefficients = dict(zip(members, xi.tolist(), strict=False))
    begin = first_unknowns(z, [coefficients[j] for j in everywhere.global_terms], None)
    penalty = penalty_of(objective, everywhere)
    trial = fit_trial(objective, everywhere, begin, STEPS, TOLERANCE, penalty)
    return trial.score < score + MARGIN
