"""Look for a hidden state that explains what the laws of a library leave."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dashred.data.sensors import Sensor
from dashred.inference.hidden_states.augmented_problem import hidden_course
from dashred.inference.hidden_states.screening import (
    Screened,
    courses_of,
    followed,
    least_level,
    screen,
    time_constants,
    track,
)
from dashred.inference.hidden_states.segment_fit import HiddenFit, changed_tau, fit_screened
from dashred.inference.segments.findings.error_growth import is_chaotic
from dashred.inference.segments.gauss_newton import NodeFit
from dashred.inference.segments.selection.beside_errors import EXPLAINED
from dashred.inference.segments.selection.search import SegmentSearch
from dashred.inference.segments.selection.set_selection import SegmentLaw, select, term_price
from dashred.inference.segments.weak_constraint import WeakConstraintProblem
from dashred.physics.hidden_state import HiddenState

# Hidden states that are fitted, the best screened first.
MAX_FITS = 6
# A hidden state has to be better than every law without one by this difference in score.
HIDDEN_GAIN = 10.0
# It is told beside at most so many terms.
MOST_BESIDE = 3
# A time constant with a larger relative standard deviation is not determined.
LARGEST_ERROR = 1 / 3
# Laws without the hidden state that are kept for comparison.
MAX_LAWS = 8


@dataclass(frozen=True)
class HiddenSearch:
    """The laws with a hidden state.

    Attributes:
        state: the hidden state, at its fitted time constant.
        equation: the equation in which it acts.
        term: what its gain multiplies.
        found: the laws of the system with the hidden state, the best first.
        price: of its time constant, of its start and of the hidden states tried, in scores.
    """

    state: HiddenState
    equation: str
    term: str
    found: SegmentSearch
    price: float


def search_hidden_states(
    found: SegmentSearch, sensors: Sequence[Sensor], equations: Sequence[str]
) -> HiddenSearch | None:
    """Return the laws with the best hidden state; None if the evidence supports none.

    A hidden state has to explain the record, and has to be better than every law without one. Its
    time constant has to be determined, and within the range that is tried. An error of the start
    must not grow over the record: an unstable hidden state could follow anything.

    Args:
        found: laws without hidden states.
        sensors: the fit sensors.
        equations: where a hidden state may act.
    """
    price, tracked = _hidden_price(found, equations), track(found)
    screened = screen(found, tracked, sensors, equations)
    if not screened or not _is_promising(found, screened, price):
        return None
    fits = []
    for each in screened[:MAX_FITS]:
        if not found.problem.deadline.is_over:
            fits.append(fit_screened(found, tracked, sensors, each))
    fits = [fit for fit in fits if math.isfinite(fit.fit.cost)]
    if not fits:
        return None
    level = found.problem.level(fit.fit.cost for fit in fits)
    own = term_price(found.problem)
    best = min(fits, key=lambda fit: fit.fit.cost / level + own * len(fit.members))
    return _selected(found, best, price)


def _selected(found: SegmentSearch, best: HiddenFit, price: float) -> HiddenSearch | None:
    """Return the laws with one hidden state beside any terms; None if none of them is told."""
    gain, problem = best.gain, best.problem
    chosen = select(problem, problem, best.fit.point, [best.members])
    known = [law for law in found.laws[:MAX_LAWS] if math.isfinite(law.fit.cost)]
    lifted = [_lifted(found, law, best) for law in known]
    with_gain = [law for law in chosen if gain in law.members]
    if not with_gain:
        return None
    ranked = _ranked(problem, [*with_gain, *lifted, *_without(chosen, gain, lifted)], gain, price)
    told = ranked[0]
    if gain not in told.members or len(told.members) > MOST_BESIDE + 1:
        return None
    within = min(law.score for law in ranked if gain not in law.members)
    if not told.score < within - HIDDEN_GAIN:
        return None
    searched = replace(found, problem=problem, natural=best.natural, laws=ranked)
    if searched.level > EXPLAINED:
        return None
    tau, std = _tau(searched, told, best.state)
    least, *_, most = time_constants(found)
    if std > LARGEST_ERROR * tau or not least < tau < most or is_chaotic(searched):
        return None
    return HiddenSearch(best.state, best.equation, best.term, searched, price)


def _tau(found: SegmentSearch, law: SegmentLaw, state: HiddenState) -> tuple[float, float]:
    """Return the fitted time constant and its standard deviation."""
    normal = found.problem.linearise(law.fit.point, law.members)
    profiled = None if normal is None else normal.profiled()
    if profiled is None:
        return state.tau, math.inf
    scale = np.sqrt(np.maximum(profiled[0].diagonal(), 1e-300))
    inverse = np.linalg.pinv(profiled[0] / scale[:, None] / scale, hermitian=True)
    std = math.sqrt(max(found.level * inverse[-1, -1], 0.0)) / float(scale[-1])
    return changed_tau(state.tau, float(law.fit.point.parameters[-1])), std


def _hidden_price(found: SegmentSearch, equations: Sequence[str]) -> float:
    """Return the cost of a time constant and a start, and of the hidden states tried."""
    tried = 2 * len(time_constants(found)) * sum(map(len, followed(found, equations).values()))
    return 2 * math.log(found.problem.segments.seen) + 2 * math.log(max(tried, 1))


def _is_promising(found: SegmentSearch, screened: Sequence[Screened], price: float) -> bool:
    """Tell whether a hidden state may be better than the best law, by linear algebra alone."""
    best, level, own = found.best, least_level(found, screened), term_price(found.problem)
    score = best.fit.cost / level + own * len(best.members)
    return screened[0].score(level, own) + price < score - HIDDEN_GAIN


def _ranked(
    problem: WeakConstraintProblem, laws: Sequence[SegmentLaw], gain: int, price: float
) -> list[SegmentLaw]:
    """Return the laws with their scores under the same noise, the best first."""
    level = problem.level(law.fit.cost for law in laws)
    own = term_price(problem)
    scored = [
        replace(
            law,
            score=law.fit.cost / level + own * len(law.members) + price * (gain in law.members),
        )
        for law in laws
    ]
    return sorted(scored, key=lambda law: law.score)


def _lifted(found: SegmentSearch, law: SegmentLaw, best: HiddenFit) -> SegmentLaw:
    """Return a law without the hidden state, which then only follows."""
    course = courses_of(found, law.fit.point, law.members)[best.state.follows]
    hidden = hidden_course(found.problem.segments, course, best.state.tau)
    point = law.fit.point
    lifted = replace(
        point,
        nodes=np.column_stack([point.nodes, hidden[:, 0]]),
        xi=np.append(point.xi, 0.0),
        parameters=np.append(point.parameters, 0.0),
    )
    return replace(law, fit=NodeFit(lifted, law.fit.cost))


def _without(
    chosen: Sequence[SegmentLaw], gain: int, lifted: Sequence[SegmentLaw]
) -> list[SegmentLaw]:
    """Return the selected laws without the gain that the earlier search did not contain."""
    known = {law.members for law in lifted}
    return [law for law in chosen if gain not in law.members and law.members not in known]
