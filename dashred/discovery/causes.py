"""Weigh the law that was found against other causes: a sensor, the start, a law somewhere only.

Every explanation is fitted with its own start and compared by the same score (design §4.3).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.discovery.beyond import laws_beyond
from dashred.discovery.candidates import Candidate
from dashred.discovery.cause import Cause, by_score
from dashred.discovery.discovered import AMBIGUOUS, MISSING
from dashred.discovery.forcing_map import ForcingMap
from dashred.discovery.free_forcing import FreeForcing, force
from dashred.discovery.law import Law, unlike
from dashred.discovery.law_simulator import Simulator
from dashred.discovery.lawless import faults, wider_starts
from dashred.discovery.local_laws import local_laws
from dashred.discovery.noise_model import NoiseModel
from dashred.discovery.objective import Objective
from dashred.discovery.on_top import screened_on_top
from dashred.discovery.own_noise import HOPELESS, under_its_own_noise
from dashred.discovery.periodic import periodic_laws
from dashred.discovery.question import SIMPLE, Question, question
from dashred.discovery.simpler import simpler_from_the_best
from dashred.discovery.threshold_profile import with_profile
from dashred.progress import Report

# χ²/n, under the noise that a free forcing leaves, of what needs no further explanation.
EXPLAINED = 1.1


@dataclass(frozen=True)
class Reach:
    """What may be added to the simulator.

    Attributes:
        everywhere: how many of the candidates, the first, may act everywhere.
        size: rms of each equation's own tendency, ``(equation,)``.
        compiled: the simulator with windows in reach: worth its seconds only if they are needed.
        beyond: terms that the library does not have, and the simulator with them in reach, and
            with some that it has.
    """

    everywhere: int
    size: Tensor
    compiled: Callable[[], Simulator]
    beyond: Callable[[Sequence[Candidate]], tuple[Simulator, Sequence[Candidate]]]


@dataclass(frozen=True)
class Weighed:
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


def weigh(
    everything: Objective,
    best: Cause,
    null: Cause,
    contested: bool,
    reach: Reach,
    report: Report,
) -> Weighed:
    """Weigh the best law that acts everywhere against other explanations.

    Args:
        everything: F of all candidates over the whole record.
        best: the best law that acts everywhere.
        null: the simulator as it is.
        contested: whether another law that acts everywhere does as well as the best.
        reach: what may be added.
        report: progress.
    """
    asked = question(everything, best, null, contested, reach.size, report)
    found, gain = _without_places(asked.best, asked.null), asked.gain
    bases = asked.bases()
    if asked.fault is not None:
        found += asked.with_fault(bases)
    waves = _periodic(asked, bases, reach)
    found += waves
    explained = min(found, key=by_score)
    simple = len(explained.law.candidates) <= SIMPLE
    if explained is not found[0] and simple and explained.law.chi2 < EXPLAINED:
        gain = 0.0
    elif asked.unclear:
        somewhere, gain = _somewhere(asked, reach, waves, report)
        found += somewhere
    elif len(asked.best.law.candidates) >= SIMPLE:
        report(0.4, "asking whether one term in a window, or beyond the library, does as well")
        found += _as_good(asked, reach)
    found += simpler_from_the_best(found)
    if asked.unclear:
        found = under_its_own_noise(found)
    nothing = min((cause for cause in found if not cause.law.parts), key=by_score)
    first = min(found, key=by_score)
    laws = unlike([with_profile(cause) if cause is first else cause.law for cause in found])
    return Weighed(laws, nothing.law, nothing.objective.noise, gain, asked.forcing)


def _periodic(asked: Question, bases: Sequence[Cause], reach: Reach) -> list[Cause]:
    """Return laws with a drive that is periodic in time."""
    bound = min(base.law.score for base in bases) + HOPELESS
    waves = [
        wave for base in bases for wave in periodic_laws(base, reach.size, reach.everywhere, bound)
    ]
    return asked.with_fault(waves)


def _somewhere(
    asked: Question, reach: Reach, waves: Sequence[Cause], report: Report
) -> tuple[list[Cause], float]:
    """Return laws in windows, and beyond the library, and what a forcing gains on the best."""
    report(0.4, "screening terms by place, time and state")
    every, null = range(len(asked.everything.prior_std)), asked.null.law.score
    whole = _through(asked.everything, reach.compiled())

    def screened(carried: FreeForcing, bound: float) -> list[Cause]:
        local = local_laws(whole, reach.everywhere, every, carried, null, bound)
        return asked.with_fault(local)

    begin = min([asked.best, *waves], key=by_score)
    found, first, nearest, gain = screened_on_top(begin, screened, asked.forced, reach.size, report)
    if gain > MISSING or len(first.law.candidates) >= SIMPLE:
        report(0.8, "screening terms beyond the library")
        further = asked.with_fault(_beyond(asked, reach, nearest, math.inf))
        gain = _gain_of(further, first, gain, reach.size)
        found += further
    return found, gain


def _as_good(asked: Question, reach: Reach) -> list[Cause]:
    """Return laws of one term, in a window or beyond the library, that may do as well."""
    whole, best = _through(asked.everything, reach.compiled()), asked.best
    bound, null = best.law.score + HOPELESS, asked.null.law.score
    alike = _alike(asked.everything, best)
    local = local_laws(whole, 0, alike, asked.forced, null, bound)
    return [*local, *_beyond(asked, reach, asked.forced, bound)]


def _beyond(asked: Question, reach: Reach, carried: FreeForcing, bound: float) -> list[Cause]:
    """Return laws with terms that the library does not have, found about a trajectory."""
    further = reach.beyond(carried.objective.shooting.candidates)
    return laws_beyond(_of(asked.everything, *further), carried, reach.everywhere, bound)


def _without_places(best: Cause, null: Cause) -> list[Cause]:
    """Return the explanations that need no further term: faults and starts beside the laws."""
    found = [best, null] if best.law.candidates else [null]
    found += faults(null, best.law.score + AMBIGUOUS)
    if best.law.candidates:
        found += faults(best, best.law.score)
    return found + wider_starts(null)


def _through(everything: Objective, simulator: Simulator) -> Objective:
    """Return F run by another simulator: one with windows in reach."""
    return replace(everything, shooting=replace(everything.shooting, simulator=simulator))


def _alike(everything: Objective, best: Cause) -> list[int]:
    """Return the candidates in the equations of a law."""
    equations = {candidate.equation for candidate in best.law.candidates}
    candidates = everything.shooting.candidates
    return [j for j, candidate in enumerate(candidates) if candidate.equation in equations]


def _gain_of(further: Sequence[Cause], first: Cause, gain: float, size: Tensor) -> float:
    """Return what a free forcing gains on top of the best of further laws, if that is the best."""
    nearest = min(further, key=by_score)
    if nearest.law.score >= first.law.score:
        return gain
    return force(nearest.objective, nearest.phi, size)[1]


def _of(objective: Objective, simulator: Simulator, candidates: Sequence[Candidate]) -> Objective:
    """Return F of other candidates; their prior is their natural scale."""
    scales = torch.tensor([c.scale for c in candidates], dtype=torch.float64)
    other = _through(objective, simulator)
    shooting = replace(other.shooting, candidates=candidates)
    return replace(other, shooting=shooting, prior_std=scales)
