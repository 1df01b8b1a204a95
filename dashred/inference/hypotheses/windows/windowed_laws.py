"""Fit the laws that screening finds: single terms with windows, and pairs that act everywhere.

Successive halving: all that screen well get a few steps, the best of these are fitted to the end,
edges, widths and all (docs/method.md#windows).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence

from torch import Tensor

from dashred.inference.fit.law import law_of
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import grow, minimise_on
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

# Hypotheses that are fitted, of which so many to the end; of one kind of window, and of one kind
# and law, not more than some: before its edges are fitted, a window screens worse than it is.
MAX_TRIALS, MAX_FINALISTS, MAX_OF_KIND, MAX_OF_LAW = 24, 8, 8, 2
FIRST_STEPS, FIRST_TOLERANCE = 3, 1e-2
LAST_STEPS, LAST_TOLERANCE = 10, 1e-4
# How many are fitted first; where all get lost, how many grow, from what share of the record, and
# by how much at once: a front that is out of step by its own width has lost its way back.
PROBES, MAX_REGROWN, FIRST_SHARE, GROWTH = 4, 6, 0.25, 1.15


def fit_windowed_laws(
    objective: LeastSquaresProblem,
    global_count: int,
    windowed: Sequence[int],
    forcing: FreeForcing,
    null_score: float,
    bound: float = math.inf,
) -> list[HypothesisFit]:
    """Return laws that act somewhere only, and others that screening finds.

    Args:
        objective: F of all candidates, its simulator with windows in reach.
        global_count: how many of these, the first, may act everywhere.
        windowed: those that may act in a window.
        forced: a free forcing that explains the recording, on top of a law or of none.
        nothing: score of the simulator as it is.
        bound: what screens worse is not fitted.
    """
    forward_model = forcing.objective.forward_model
    states = forward_model.sampled_states(*forcing.objective.split(forcing.phi))
    screened = screen(objective, global_count, windowed, forcing, states)
    near = [found for found in screened if _predicted_score(objective, found) < bound]
    ranked = sorted(near, key=lambda found: _predicted_score(objective, found))
    chosen = _select_various(ranked, MAX_OF_LAW, MAX_TRIALS)
    z = forcing.phi[: objective.modes]
    trials = _fit_trials(objective, chosen, z)
    best = min((trial.score for trial in trials), default=null_score)
    finalists = [
        trial
        for trial in _finalists(trials)
        if trial.score < min(best + REJECTION_MARGIN, null_score)
    ]
    finished_pairs = [(trial.hypothesis, _fit_to_end(trial)) for trial in finalists]
    parts = (
        _fit_terms_alone(objective, *min(finished_pairs, key=lambda pair: by_score(pair[1])))
        if finished_pairs
        else []
    )
    finished = sorted([*(fit for _, fit in finished_pairs), *parts], key=by_score)
    finished = sorted([*finished, *restart_windows(finished)], key=by_score)
    return [*map(refine, finished[:1]), *finished[1:]]


def _finalists(trials: Sequence[HypothesisTrial]) -> list[HypothesisTrial]:
    """Return what did best in its first steps, and whatever screens best.

    The edges of a window take more than the first steps to find their place.
    """
    ranked = sorted(range(len(trials)), key=lambda j: trials[j].score)
    return [trials[j] for j in sorted({*ranked[:MAX_FINALISTS], *range(min(PROBES, len(trials)))})]


def _fit_terms_alone(
    objective: LeastSquaresProblem, hypothesis: Hypothesis, pair: HypothesisFit
) -> list[HypothesisFit]:
    """Return each term of a pair alone, fitted from where the pair is.

    From the trajectory of a forcing one may not get there, and the other is spurious.
    """
    if len(hypothesis.global_terms) < 2:
        return []
    z, xi = objective.split(pair.phi)
    alone = []
    for j, coefficient in zip(hypothesis.global_terms, xi.tolist(), strict=False):
        part = Hypothesis((j,))
        begin = first_unknowns(z, [coefficient], None)
        penalty = _penalty(objective, part)
        trial = fit_trial(objective, part, begin, FIRST_STEPS, FIRST_TOLERANCE, penalty)
        alone.append(_fit_to_end(trial))
    return alone


def _select_various(
    ranked: Iterable[ScreenedHypothesis], most_of_law: int, most: int
) -> list[ScreenedHypothesis]:
    """Return the best, but of one kind, and of one kind and law, not more than a few."""
    kinds: Counter[str] = Counter()
    laws: Counter[object] = Counter()
    chosen = []
    for found in ranked:
        h = found.hypothesis
        law = h.kind, h.global_terms, h.windowed_terms
        if kinds[h.kind] < MAX_OF_KIND and laws[law] < most_of_law:
            kinds[h.kind] += 1
            laws[law] += 1
            chosen.append(found)
        if len(chosen) == most:
            break
    return chosen


def _fit_trials(
    objective: LeastSquaresProblem, chosen: Sequence[ScreenedHypothesis], z: Tensor
) -> list[HypothesisTrial]:
    """Give what screens well a few steps.

    Over a long record an edge that is a little off may carry the trajectory away from the
    recording. What gets lost so is fitted over a horizon that grows; and where the first do all
    of them, the others would too.
    """

    def is_lost(found: ScreenedHypothesis, trial: HypothesisTrial) -> bool:
        return trial.score > _predicted_score(objective, found) + objective.noise.count

    first, rest = chosen[:PROBES], chosen[PROBES:]
    trials = [_fit_screened(objective, found, z) for found in first]
    regrown = [found for found, trial in zip(first, trials, strict=True) if is_lost(found, trial)]
    if len(regrown) < len(first):
        trials += [_fit_screened(objective, found, z) for found in rest]
    else:
        regrown = _select_various(chosen, 1, MAX_REGROWN)
    samples = round(len(objective.recorded) * FIRST_SHARE)
    return trials + [_fit_screened(objective, found, z, samples) for found in regrown]


def _predicted_score(objective: LeastSquaresProblem, found: ScreenedHypothesis) -> float:
    """Return the score that the linearised problem promises."""
    return found.cost + _penalty(objective, found.hypothesis)


def _penalty(objective: LeastSquaresProblem, hypothesis: Hypothesis) -> float:
    windows = len(objective.forward_model.simulator.shapes)
    count = len(objective.prior_std)
    return hypothesis.penalty(objective.noise.effective_count, count, windows)


def _fit_screened(
    objective: LeastSquaresProblem, found: ScreenedHypothesis, z: Tensor, samples: int | None = None
) -> HypothesisTrial:
    begin = first_unknowns(z, found.coefficients, found.hypothesis.guess)
    if samples is not None:
        begin = grow(build_problem(objective, found.hypothesis), begin, samples, GROWTH)
    penalty = _penalty(objective, found.hypothesis)
    return fit_trial(objective, found.hypothesis, begin, FIRST_STEPS, FIRST_TOLERANCE, penalty)


def _fit_to_end(trial: HypothesisTrial) -> HypothesisFit:
    problem, before = trial.objective, trial.fitted
    fitted = minimise_on(problem, before.phi, LAST_STEPS, LAST_TOLERANCE, AMBIGUITY_MARGIN)
    score = trial.score - before.cost + fitted.cost
    return HypothesisFit(law_of(problem, fitted, score), problem, fitted.phi)
