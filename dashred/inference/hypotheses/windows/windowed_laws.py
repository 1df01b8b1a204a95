"""Fits of the laws that screening finds: single terms with windows, and pairs without a window.

The fits use successive halving (docs/method.md#windows). All laws that screen well are fitted for a
few steps. The best of them are fitted until convergence, including the edges and widths of the
windows.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from functools import partial

from torch import Tensor

from dashred.core.budget import in_time
from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.independent_fits import Fit, fit_in_time
from dashred.inference.fit.law import Law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import (
    FitResult,
    minimise,
    minimise_growing_horizon,
    minimise_in_rounds,
)
from dashred.inference.hypotheses.free_forcing import FreeForcing
from dashred.inference.hypotheses.hypothesis_fit import (
    REJECTION_MARGIN,
    HypothesisFit,
    by_score,
    refine,
)
from dashred.inference.hypotheses.result import AMBIGUITY_MARGIN
from dashred.inference.hypotheses.windows.screening import ScreenedHypothesis, screen
from dashred.inference.hypotheses.windows.window_restarts import restart_windows
from dashred.inference.hypotheses.windows.windowed_hypothesis import (
    Hypothesis,
    HypothesisTrial,
    build_problem,
    first_unknowns,
    fit_trial,
)

# Number of hypotheses that are fitted for a few steps and until convergence, and the largest number
# with one kind of window, and with one kind and law. The choice is kept diverse because a window
# screens worse than it fits, before its edges are fitted.
MAX_TRIALS, MAX_FINALISTS, MAX_OF_KIND, MAX_OF_LAW = 24, 8, 8, 2
FIRST_STEPS, FIRST_TOLERANCE = 3, 1e-2
LAST_STEPS, LAST_TOLERANCE = 10, 1e-4
# Number of hypotheses that are fitted first. If all of these lose the recording, MAX_REGROWN are
# fitted over a horizon that begins with FIRST_SHARE of the record and grows by GROWTH. The factor
# is small, because a front that is displaced by its own width is not found again.
PROBES, MAX_REGROWN, FIRST_SHARE, GROWTH = 4, 6, 0.25, 1.15


def fit_windowed_laws(
    objective: LeastSquaresProblem,
    global_count: int,
    windowed: Sequence[int],
    forcing: FreeForcing,
    null_score: float,
    bound: float = math.inf,
) -> list[HypothesisFit]:
    """Screen laws with and without a window, and fit the best of them.

    Args:
        objective: F of all candidates; its simulator has windows.
        global_count: number of candidates that may act everywhere; these come first.
        windowed: indices of the candidates that may act in a window.
        forcing: a free forcing that explains the recording, on top of a law or of none.
        null_score: score of the uncorrected simulator.
        bound: laws with a worse screening score are not fitted.
    """
    forward_model = forcing.objective.forward_model
    states = forward_model.sampled_states(*forcing.objective.split(forcing.phi))
    # A program may fail along the trajectory of the forcing: then nothing can be screened.
    if not states.isfinite().all():
        return []
    screened = screen(objective, global_count, windowed, forcing, states)
    plausible = [each for each in screened if predicted_score(objective, each) < bound]
    ranked = sorted(plausible, key=lambda each: predicted_score(objective, each))
    chosen = select_diverse(ranked, MAX_OF_LAW, MAX_TRIALS)
    z = forcing.phi[: objective.modes]
    trials = _fit_trials(objective, chosen, z)
    best = min((trial.score for trial in trials), default=null_score)
    bound = min(best + REJECTION_MARGIN, null_score)
    finalists = [trial for trial in _select_finalists(trials) if trial.score < bound]
    fits = fit_until_convergence(finalists)
    pairs = [(trial.hypothesis, fit) for trial, fit in zip(finalists, fits, strict=False)]
    if pairs:
        fits += _fit_terms_alone(objective, *min(pairs, key=lambda pair: by_score(pair[1])))
    fits.sort(key=by_score)
    fits = sorted([*fits, *restart_windows(fits)], key=by_score)
    return [*map(refine, fits[:1]), *fits[1:]]


def _select_finalists(trials: Sequence[HypothesisTrial]) -> list[HypothesisTrial]:
    """Return the best trials, and the trials of the hypotheses that screen best.

    The edges of a window may need more steps than a trial has.
    """
    ranked = sorted(range(len(trials)), key=lambda j: trials[j].score)
    return [trials[j] for j in sorted({*ranked[:MAX_FINALISTS], *range(min(PROBES, len(trials)))})]


def _fit_terms_alone(
    objective: LeastSquaresProblem, hypothesis: Hypothesis, pair: HypothesisFit
) -> list[HypothesisFit]:
    """Fit each term of a pair alone, from the minimum of the pair.

    One of the terms may be spurious, and a fit of the other one from the trajectory of a forcing
    may not arrive at this minimum.
    """
    if len(hypothesis.global_terms) < 2:
        return []
    z, xi = objective.split(pair.phi)

    def fit_alone(term: tuple[int, float]) -> HypothesisTrial:
        j, coefficient = term
        part = Hypothesis((j,))
        begin = first_unknowns(z, [coefficient], None)
        penalty = penalty_of(objective, part)
        return fit_trial(objective, part, begin, FIRST_STEPS, FIRST_TOLERANCE, penalty)

    terms = zip(hypothesis.global_terms, xi.tolist(), strict=False)
    return fit_until_convergence(in_time(fit_alone, terms))


def select_diverse(
    ranked: Iterable[ScreenedHypothesis], max_of_law: int, max_count: int
) -> list[ScreenedHypothesis]:
    """Return the best hypotheses, but only a few of one kind, and of one kind and law."""
    kinds: Counter[str] = Counter()
    laws: Counter[object] = Counter()
    chosen = []
    for screened in ranked:
        h = screened.hypothesis
        law = h.kind, h.global_terms, h.windowed_terms
        if kinds[h.kind] < MAX_OF_KIND and laws[law] < max_of_law:
            kinds[h.kind] += 1
            laws[law] += 1
            chosen.append(screened)
        if len(chosen) == max_count:
            break
    return chosen


def _fit_trials(
    objective: LeastSquaresProblem, chosen: Sequence[ScreenedHypothesis], z: Tensor
) -> list[HypothesisTrial]:
    """Fit the hypotheses that screen well for a few steps.

    Over a long record an edge that is slightly wrong may drive the trajectory away from the
    recording. Such a hypothesis is fitted over a growing horizon. If all of the first hypotheses
    are lost, the others would be lost too.
    """

    def is_lost(screened: ScreenedHypothesis, trial: HypothesisTrial) -> bool:
        return trial.score > predicted_score(objective, screened) + objective.noise.count

    first, rest = chosen[:PROBES], chosen[PROBES:]
    trials = fit_screened(objective, first, z)
    regrown = [each for each, trial in zip(first, trials, strict=False) if is_lost(each, trial)]
    if len(regrown) < len(first):
        trials += fit_screened(objective, rest, z)
    else:
        regrown = select_diverse(chosen, 1, MAX_REGROWN)
    samples = round(len(objective.recorded) * FIRST_SHARE)
    return trials + fit_screened(objective, regrown, z, samples)


def predicted_score(objective: LeastSquaresProblem, screened: ScreenedHypothesis) -> float:
    """Return the score predicted by the linearised problem."""
    return screened.cost + penalty_of(objective, screened.hypothesis)


def penalty_of(objective: LeastSquaresProblem, hypothesis: Hypothesis) -> float:
    """Return the penalty of a hypothesis in the problem of all candidates."""
    windows = len(objective.forward_model.simulator.shapes)
    count = len(objective.prior_std)
    return hypothesis.penalty(objective.noise.effective_count, count, windows)


def fit_screened(
    objective: LeastSquaresProblem,
    chosen: Sequence[ScreenedHypothesis],
    z: Tensor,
    samples: int | None = None,
) -> list[HypothesisTrial]:
    """Fit hypotheses for a few steps, from their minima on the linearised problem.

    Args:
        objective: F of all candidates.
        chosen: the hypotheses.
        z: unknowns of the start at which the fits begin.
        samples: first samples of a growing horizon; None fits all samples at once.

    Returns:
        The trials in order, as far as the time allows.
    """
    problems = [build_problem(objective, each.hypothesis) for each in chosen]
    fits = []
    for each, problem in zip(chosen, problems, strict=True):
        begin = first_unknowns(z, each.coefficients, each.hypothesis.guess)
        fits.append(Fit(problem, partial(_fit_briefly, phi=begin, samples=samples)))
    return [
        HypothesisTrial(
            each.hypothesis, problem, fitted, fitted.cost + penalty_of(objective, each.hypothesis)
        )
        for each, problem, fitted in zip(chosen, problems, fit_in_time(fits), strict=False)
    ]


def _fit_briefly(problem: LeastSquaresProblem, phi: Tensor, samples: int | None) -> FitResult:
    if samples is not None:
        phi = minimise_growing_horizon(problem, phi, samples, GROWTH)
    return minimise(problem, phi, FIRST_STEPS, FIRST_TOLERANCE)


def fit_until_convergence(trials: Sequence[HypothesisTrial]) -> list[HypothesisFit]:
    """Return trials fitted until convergence, in order, as far as the time allows."""
    fits = [
        Fit(
            trial.objective,
            partial(_converge, phi=trial.fitted.phi, penalty=trial.score - trial.fitted.cost),
        )
        for trial in trials
    ]
    return [
        HypothesisFit(law, trial.objective, phi)
        for trial, (law, phi) in zip(trials, fit_in_time(fits), strict=False)
    ]


def _converge(problem: LeastSquaresProblem, phi: Tensor, penalty: float) -> tuple[Law, Tensor]:
    fitted = minimise_in_rounds(problem, phi, LAST_STEPS, LAST_TOLERANCE, AMBIGUITY_MARGIN)
    return build_law(problem, fitted, penalty + fitted.cost), fitted.phi
