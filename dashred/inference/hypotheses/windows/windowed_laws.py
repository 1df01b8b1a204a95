"""Fit the laws that screening finds: single terms with windows, and pairs that act everywhere.

Successive halving: all that screen well get a few steps, the best of these are fitted to the end,
edges, widths and all (docs/method.md#windows).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence

from torch import Tensor

from dashred.inference.fit.law import build_law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise_growing_horizon, minimise_in_rounds
from dashred.inference.hypotheses.free_forcing import FreeForcing
from dashred.inference.hypotheses.hypothesis_fit import HOPELESS, HypothesisFit, by_score, settled
from dashred.inference.hypotheses.result import AMBIGUOUS
from dashred.inference.hypotheses.windows.screening import Screened, screen
from dashred.inference.hypotheses.windows.window_restarts import restart_windows
from dashred.inference.hypotheses.windows.windowed_hypothesis import (
    Hypothesis,
    Tested,
    build_problem,
    first_unknowns,
    test,
)

# Hypotheses that are fitted, of which so many to the end; of one kind of window, and of one kind
# and law, not more than some: before its edges are fitted, a window screens worse than it is.
TRIED, FINALISTS, KIND, ALIKE = 24, 8, 8, 2
FIRST_STEPS, FIRST_TOLERANCE = 3, 1e-2
LAST_STEPS, LAST_TOLERANCE = 10, 1e-4
# How many are fitted first; where all get lost, how many grow, from what share of the record, and
# by how much at once: a front that is out of step by its own width has lost its way back.
PROBES, AGAIN, BEGIN, GROWTH = 4, 6, 0.25, 1.15


def windowed_laws(
    objective: LeastSquaresProblem,
    global_count: int,
    windowed: Sequence[int],
    forced: FreeForcing,
    nothing: float,
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
    forward_model = forced.objective.forward_model
    states = forward_model.sampled_states(*forced.objective.split(forced.phi))
    screened = screen(objective, global_count, windowed, forced, states)
    near = [found for found in screened if _expected(objective, found) < bound]
    ranked = sorted(near, key=lambda found: _expected(objective, found))
    chosen = _various(ranked, ALIKE, TRIED)
    z = forced.phi[: objective.modes]
    tried = _tries(objective, chosen, z)
    best = min((tested.score for tested in tried), default=nothing)
    kept = [tested for tested in _finalists(tried) if tested.score < min(best + HOPELESS, nothing)]
    done = [(tested.hypothesis, _finish(tested)) for tested in kept]
    parts = _parts(objective, *min(done, key=lambda pair: by_score(pair[1]))) if done else []
    finished = sorted([*(cause for _, cause in done), *parts], key=by_score)
    finished = sorted([*finished, *restart_windows(finished)], key=by_score)
    return [*map(settled, finished[:1]), *finished[1:]]


def _finalists(tried: Sequence[Tested]) -> list[Tested]:
    """Return what did best in its first steps, and whatever screens best.

    The edges of a window take more than the first steps to find their place.
    """
    ranked = sorted(range(len(tried)), key=lambda j: tried[j].score)
    return [tried[j] for j in sorted({*ranked[:FINALISTS], *range(min(PROBES, len(tried)))})]


def _parts(
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
        tested = test(objective, part, begin, FIRST_STEPS, FIRST_TOLERANCE, penalty)
        alone.append(_finish(tested))
    return alone


def _various(ranked: Iterable[Screened], alike: int, most: int) -> list[Screened]:
    """Return the best, but of one kind, and of one kind and law, not more than a few."""
    kinds: Counter[str] = Counter()
    laws: Counter[object] = Counter()
    chosen = []
    for found in ranked:
        h = found.hypothesis
        law = h.kind, h.global_terms, h.windowed_terms
        if kinds[h.kind] < KIND and laws[law] < alike:
            kinds[h.kind] += 1
            laws[law] += 1
            chosen.append(found)
        if len(chosen) == most:
            break
    return chosen


def _tries(objective: LeastSquaresProblem, chosen: Sequence[Screened], z: Tensor) -> list[Tested]:
    """Give what screens well a few steps.

    Over a long record an edge that is a little off may carry the trajectory away from the
    recording. What gets lost so is fitted over a horizon that grows; and where the first do all
    of them, the others would too.
    """

    def lost(found: Screened, tested: Tested) -> bool:
        return tested.score > _expected(objective, found) + objective.noise.count

    first, rest = chosen[:PROBES], chosen[PROBES:]
    tried = [_try(objective, found, z) for found in first]
    again = [found for found, tested in zip(first, tried, strict=True) if lost(found, tested)]
    if len(again) < len(first):
        tried += [_try(objective, found, z) for found in rest]
    else:
        again = _various(chosen, 1, AGAIN)
    samples = round(len(objective.recorded) * BEGIN)
    return tried + [_try(objective, found, z, samples) for found in again]


def _expected(objective: LeastSquaresProblem, found: Screened) -> float:
    """Return the score that the linearised problem promises."""
    return found.cost + _penalty(objective, found.hypothesis)


def _penalty(objective: LeastSquaresProblem, hypothesis: Hypothesis) -> float:
    windows = len(objective.forward_model.simulator.shapes)
    count = len(objective.prior_std)
    return hypothesis.penalty(objective.noise.effective_count, count, windows)


def _try(
    objective: LeastSquaresProblem, found: Screened, z: Tensor, samples: int | None = None
) -> Tested:
    begin = first_unknowns(z, found.coefficients, found.hypothesis.guess)
    if samples is not None:
        begin = minimise_growing_horizon(
            build_problem(objective, found.hypothesis), begin, samples, GROWTH
        )
    penalty = _penalty(objective, found.hypothesis)
    return test(objective, found.hypothesis, begin, FIRST_STEPS, FIRST_TOLERANCE, penalty)


def _finish(tested: Tested) -> HypothesisFit:
    mine, before = tested.objective, tested.fitted
    fitted = minimise_in_rounds(mine, before.phi, LAST_STEPS, LAST_TOLERANCE, AMBIGUOUS)
    score = tested.score - before.cost + fitted.cost
    return HypothesisFit(build_law(mine, fitted, score), mine, fitted.phi)
