"""Weigh the law that was found against other causes: a sensor, the start, a law somewhere only.

Every explanation is fitted with its own start and compared by the same score
(docs/method.md#comparison-of-hypotheses).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from torch import Tensor

from dashred.core.progress import Report
from dashred.inference.fit.law import Law, distinct_laws
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.simulator import Simulator
from dashred.inference.hypotheses.comparison.backward_elimination import eliminate_terms
from dashred.inference.hypotheses.comparison.noise_reestimation import (
    refitted_under,
    refitted_under_own_noise,
)
from dashred.inference.hypotheses.comparison.repeated_screening import repeat_screening
from dashred.inference.hypotheses.comparison.residual_forcing import (
    SIMPLE,
    ResidualForcing,
    fit_residual_forcing,
)
from dashred.inference.hypotheses.extended.extended_library import extended_laws
from dashred.inference.hypotheses.extended.periodic_forcing import periodic_laws
from dashred.inference.hypotheses.forcing_map import ForcingMap
from dashred.inference.hypotheses.free_forcing import FreeForcing, force
from dashred.inference.hypotheses.hypothesis_fit import HOPELESS, HypothesisFit, by_score, refitted
from dashred.inference.hypotheses.result import AMBIGUOUS, MISSING
from dashred.inference.hypotheses.sensors.sensor_and_start_faults import (
    sensor_hypotheses,
    start_hypotheses,
)
from dashred.inference.hypotheses.windows.threshold_likelihood import with_profile
from dashred.inference.hypotheses.windows.windowed_laws import windowed_laws

# χ²/n, under the noise that a free forcing leaves, of what needs no further explanation.
EXPLAINED = 1.1


@dataclass(frozen=True)
class Additions:
    """What may be added to the simulator.

    Attributes:
        global_count: how many of the candidates, the first, may act everywhere.
        size: rms of each equation's own tendency, ``(equation,)``.
        compiled: the simulator with windows in reach: worth its seconds only if they are needed.
        extended: terms that the library does not have.
    """

    global_count: int
    size: Tensor
    compiled: Callable[[], Simulator]
    extended: Callable[[], Sequence[Candidate]]


@dataclass(frozen=True)
class Comparison:
    """All explanations, under one noise.

    Attributes:
        laws: the best first.
        nothing: the simulator as it is, with its own best start.
        noise: under which they were scored.
        gain: evidence for a free forcing on top of the best.
        forcing: the map of one on top of the simulator as it is; None where the best law leaves
            no question, nothing is missing, or no forcing can be fitted.
    """

    laws: list[Law]
    nothing: Law
    noise: NoiseModel
    gain: float
    forcing: ForcingMap | None


def compare_hypotheses(
    everything: LeastSquaresProblem,
    best: HypothesisFit,
    null: HypothesisFit,
    rivals: Sequence[HypothesisFit],
    additions: Additions,
    report: Report,
) -> Comparison:
    """Weigh the best law that acts everywhere against other explanations.

    Args:
        everything: F of all candidates over the whole record.
        best: the best law that acts everywhere.
        null: the simulator as it is.
        rivals: other laws that act everywhere and do about as well as the best.
        additions: what may be added.
        report: progress.
    """
    contested = len(best.law.candidates) > 1 and bool(rivals)
    left = fit_residual_forcing(everything, best, null, contested, additions.size, report)
    found, gain = _without_places(left.best, left.null), left.gain
    bases = left.bases()
    if left.fault is not None:
        found += left.with_fault(bases)
    waves = _periodic(left, bases, additions)
    found += waves
    explained = min(found, key=by_score)
    simple = len(explained.law.candidates) <= SIMPLE
    if explained is not found[0] and simple and explained.law.chi2 < EXPLAINED:
        gain = 0.0
    elif left.unclear:
        somewhere, gain = _somewhere(left, additions, waves, report)
        found += somewhere
    elif len(left.best.law.candidates) >= SIMPLE:
        report(0.4, "asking whether one term in a window, or beyond the library, does as well")
        found += _as_good(left, additions)
    found += eliminate_terms(found)
    found += _rivals_of_the_faulty(left, found, rivals)
    if left.unclear:
        found = refitted_under_own_noise(found)
    nothing = min((cause for cause in found if not cause.law.parts), key=by_score)
    first = min(found, key=by_score)
    laws = distinct_laws([with_profile(cause) if cause is first else cause.law for cause in found])
    return Comparison(laws, nothing.law, nothing.objective.noise, gain, left.forcing)


def _periodic(
    left: ResidualForcing, bases: Sequence[HypothesisFit], additions: Additions
) -> list[HypothesisFit]:
    """Return laws with a drive that is periodic in time."""
    bound = min(base.law.score for base in bases) + HOPELESS
    waves = [
        wave
        for base in bases
        for wave in periodic_laws(base, additions.size, additions.global_count, bound)
    ]
    return left.with_fault(waves)


def _somewhere(
    left: ResidualForcing, additions: Additions, waves: Sequence[HypothesisFit], report: Report
) -> tuple[list[HypothesisFit], float]:
    """Return laws in windows, and beyond the library, and what a forcing gains on the best."""
    report(0.4, "screening terms by place, time and state")
    every, null = range(len(left.everything.prior_std)), left.null.law.score
    whole = _through(left.everything, additions.compiled())

    def screened(carried: FreeForcing, bound: float) -> list[HypothesisFit]:
        local = windowed_laws(whole, additions.global_count, every, carried, null, bound)
        return left.with_fault(local)

    begin = min([left.best, *waves], key=by_score)
    found, first, nearest, gain = repeat_screening(
        begin, screened, left.carriers, additions.size, report
    )
    if gain > MISSING or len(first.law.candidates) >= SIMPLE:
        report(0.8, "screening terms beyond the library")
        further = left.with_fault(_extended(left, additions, nearest, math.inf))
        gain = _gain_of(further, first, gain, additions.size)
        found += further
    return found, gain


def _as_good(left: ResidualForcing, additions: Additions) -> list[HypothesisFit]:
    """Return laws of one term, in a window or beyond the library, that may do as well."""
    whole, best = _through(left.everything, additions.compiled()), left.best
    bound, null = best.law.score + HOPELESS, left.null.law.score
    alike = _alike(left.everything, best)
    local = windowed_laws(whole, 0, alike, left.forced, null, bound)
    return [*local, *_extended(left, additions, left.forced, bound)]


def _extended(
    left: ResidualForcing, additions: Additions, carried: FreeForcing, bound: float
) -> list[HypothesisFit]:
    """Return laws with terms that the library does not have, found about a trajectory."""
    further, library = additions.extended(), additions.global_count
    return extended_laws(left.everything, further, carried, library, bound)


def _without_places(best: HypothesisFit, null: HypothesisFit) -> list[HypothesisFit]:
    """Return the explanations that need no further term: faults and starts beside the laws."""
    found = [best, null] if best.law.candidates else [null]
    found += sensor_hypotheses(null, best.law.score + AMBIGUOUS)
    if best.law.candidates:
        found += sensor_hypotheses(best, best.law.score)
    return found + start_hypotheses(null, best.law.score + HOPELESS)


def _rivals_of_the_faulty(
    left: ResidualForcing, found: Sequence[HypothesisFit], rivals: Sequence[HypothesisFit]
) -> list[HypothesisFit]:
    """Return the best law's rivals, with and without a fault, where it has won beside one itself.

    Each of them alone stands farther from it than from the best law alone.
    """
    first, noise = min(found, key=by_score), left.everything.noise
    if first.law.fault is None or first.law.keys != left.best.law.keys:
        return []
    if left.fault is not None:
        without = [refitted(rival, replace(rival.objective, noise=noise)) for rival in rivals]
        return left.with_fault(without)
    bound = first.law.score + AMBIGUOUS
    mine = [refitted_under(rival, noise) for rival in rivals]
    return [*mine, *(beside for rival in mine for beside in sensor_hypotheses(rival, bound))]


def _through(everything: LeastSquaresProblem, simulator: Simulator) -> LeastSquaresProblem:
    """Return F run by another simulator: one with windows in reach."""
    return replace(everything, forward_model=replace(everything.forward_model, simulator=simulator))


def _alike(everything: LeastSquaresProblem, best: HypothesisFit) -> list[int]:
    """Return the candidates in the equations of a law."""
    equations = {candidate.equation for candidate in best.law.candidates}
    candidates = everything.forward_model.law.candidates
    return [j for j, candidate in enumerate(candidates) if candidate.equation in equations]


def _gain_of(
    further: Sequence[HypothesisFit], first: HypothesisFit, gain: float, size: Tensor
) -> float:
    """Return what a free forcing gains on top of the best of further laws, if that is the best."""
    nearest = min(further, key=by_score)
    if nearest.law.score >= first.law.score:
        return gain
    return force(nearest.objective, nearest.phi, size)[1]
