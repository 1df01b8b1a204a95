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
from dashred.discovery.cause import Cause, by_score, refitted, settled
from dashred.discovery.discovered import AMBIGUOUS, MISSING
from dashred.discovery.forcing_map import ForcingMap, map_of
from dashred.discovery.free_forcing import FreeForcing, force
from dashred.discovery.law import Law, unlike
from dashred.discovery.lawless import faults, wider_starts
from dashred.discovery.left_out import (
    Beside,
    beside_the_fault,
    fault_beneath,
    faulty_or_not,
    forced_without,
    nothing_without,
)
from dashred.discovery.local_laws import local_laws
from dashred.discovery.noise_model import NoiseModel
from dashred.discovery.objective import Objective
from dashred.discovery.on_top import screened_on_top
from dashred.discovery.periodic import periodic_laws
from dashred.discovery.shooting import Simulator
from dashred.discovery.simpler import simpler_from_the_best
from dashred.discovery.threshold_profile import with_profile
from dashred.progress import Report

# A law of more candidates may imitate one that acts somewhere only, or is beyond the library; of so
# many, one beyond it, or in a window of the same equations.
SIMPLE = 2
# But one whose every coefficient stands at least so many of its std from none imitates no other.
CERTAIN = 30.0
# χ²/n, under the noise that a free forcing leaves, of what needs no further explanation.
EXPLAINED = 1.1
# Noise this many times as large as under the best law says that a forcing alone has gone astray: it
# cannot steer chaos over a long record.
ASTRAY = 1.2
# A score this much worse than the best is out of the question.
HOPELESS = 60.0


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
    everywhere: int,
    best: Cause,
    null: Cause,
    contested: bool,
    size: Tensor,
    compiled: Callable[[], Simulator],
    beyond: Callable[[Sequence[Candidate]], tuple[Simulator, Sequence[Candidate]]],
    report: Report,
) -> Weighed:
    """Weigh the best law that acts everywhere against other explanations.

    Args:
        everything: F of all candidates over the whole record.
        everywhere: how many of the candidates, the first, may act everywhere.
        best: the best law that acts everywhere.
        null: the simulator as it is.
        contested: whether another law that acts everywhere does as well as the best.
        size: rms of each equation's own tendency, ``(equation,)``.
        compiled: the simulator with windows in reach: worth its seconds only if they are needed.
        beyond: terms that the library does not have, and the simulator with them in reach, and
            with some that it has.
        report: progress.
    """
    forced, gain = force(best.objective, best.phi, size)
    forcing = fault = None
    report(0.2, f"a free forcing gains {gain:.0f}")
    unclear = gain > MISSING or contested or _may_imitate(best.law)
    if unclear:
        forced, forcing = _carried(forced, gain, best, null, size)
        fault = fault_beneath(forced)
        if fault is not None:
            report(0.3, f"a {fault.kind} beneath the mismatch: looking on without that sensor")
            forced = forced_without(forced, fault.sensor)
        noise = _noise_under(forced)
        everything = replace(everything, noise=noise)
        best, null = _again(best, noise), _again(null, noise)

    def with_fault(laws: list[Cause]) -> list[Cause]:
        return laws if fault is None else faulty_or_not(laws, fault.sensor)

    found = _without_places(best, null)
    bases = [best, null] if best.law.candidates else [null]
    if fault is not None:
        bases = [nothing_without(null, forced, noise)]
        found += with_fault(bases)
    bound = min(base.law.score for base in bases) + HOPELESS
    waves = [wave for base in bases for wave in periodic_laws(base, size, everywhere, bound)]
    waves = with_fault(waves)
    found += waves

    def further_laws(carried: FreeForcing, bound: float = math.inf) -> list[Cause]:
        reach = beyond(carried.objective.shooting.candidates)
        return laws_beyond(_of(everything, *reach), carried, everywhere, bound)

    explained = min(found, key=by_score)
    simple = len(explained.law.candidates) <= SIMPLE
    if explained is not found[0] and simple and explained.law.chi2 < EXPLAINED:
        gain = 0.0
    elif unclear:
        report(0.4, "screening terms by place, time and state")
        every = range(len(everything.prior_std))
        whole = _through(everything, compiled())

        def screened(carried: FreeForcing, bound: float) -> list[Cause]:
            return with_fault(local_laws(whole, everywhere, every, carried, null.law.score, bound))

        begin = min([best, *waves], key=by_score)
        local, first, nearest, gain = screened_on_top(begin, screened, forced, size, report)
        found += local
        if gain > MISSING or len(first.law.candidates) >= SIMPLE:
            report(0.8, "screening terms beyond the library")
            further = with_fault(further_laws(nearest))
            gain = _gain_of(further, first, gain, size)
            found += further
    elif len(best.law.candidates) >= SIMPLE:
        report(0.4, "asking whether one term in a window, or beyond the library, does as well")
        whole = _through(everything, compiled())
        bound = best.law.score + HOPELESS
        found += local_laws(whole, 0, _alike(everything, best), forced, null.law.score, bound)
        found += further_laws(forced, bound)
    found += simpler_from_the_best(found)
    if unclear:
        found = _under_its_own_noise(found)
    nothing = min((cause for cause in found if not cause.law.parts), key=by_score)
    best = min(found, key=by_score)
    laws = unlike([with_profile(cause) if cause is best else cause.law for cause in found])
    return Weighed(laws, nothing.law, nothing.objective.noise, gain, forcing)


def _carried(
    on_best: FreeForcing, gain: float, best: Cause, null: Cause, size: Tensor
) -> tuple[FreeForcing, ForcingMap | None]:
    """Return a free forcing about whose trajectory to look on, and the map of one.

    That is one on the simulator as it is. Where the best law leaves nothing unexplained, it comes
    nearer to the truth than a forcing, which is as coarse as its cells: unless it is a law of many
    terms, and the forcing leaves less. Where a forcing alone goes astray, the best law carries it,
    and there is no map.
    """
    alone, missing = (on_best, gain) if best is null else force(null.objective, null.phi, size)
    ratio = float((_noise_under(alone).std / _noise_under(on_best).std).median())
    if ratio > ASTRAY:
        return on_best, None
    nearer = gain <= MISSING and (len(best.law.candidates) <= SIMPLE or ratio > 1)
    return on_best if nearer else alone, map_of(alone, missing)


def _may_imitate(law: Law) -> bool:
    """Tell whether a law has so many terms that it may be an imitation of another."""
    certain = bool((law.coefficients.abs() >= CERTAIN * law.std).all())
    return len(law.candidates) > SIMPLE and not certain


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


def _under_its_own_noise(found: Sequence[Cause]) -> list[Cause]:
    """Fit all that may still be right again, under the noise that the best of them leaves.

    A free forcing takes less from the residuals than it spends: what it leaves is too large, and
    hides lower minima of the best.
    """
    best = min(found, key=by_score)
    [readings] = best.objective.shooting.readings(*best.objective.split(best.phi[None]))
    noise = best.objective.noise_left(readings, len(best.phi))
    bound = best.law.score + HOPELESS
    kept = [cause for cause in found if cause.law.score < bound or not cause.law.parts]
    again = [_again(cause, noise) for cause in kept]
    best = min(again, key=by_score)
    lawful = best.law.candidates and best.law.fault is None
    return [settled(cause) if cause is best and lawful else cause for cause in again]


def _noise_under(forced: FreeForcing) -> NoiseModel:
    """Return the noise that is left under a free forcing: no wrong law has a part in it."""
    objective, phi = forced.objective, forced.phi
    [readings] = objective.shooting.readings(*objective.split(phi[None]))
    normal = forced.normal
    information = normal.hessian - torch.diag(normal.precision)
    spent = float(torch.linalg.solve(normal.hessian, information).trace())
    return replace(objective.noise_left(readings, round(spent)), seen=objective.noise.seen)


def _again(cause: Cause, noise: NoiseModel) -> Cause:
    """Return an explanation fitted under another noise; the samples that it sees stay its own."""
    if isinstance(cause, Beside):
        return beside_the_fault(_again(cause.bare, noise), cause.sensor)
    before = cause.objective
    return refitted(cause, replace(before, noise=replace(noise, seen=before.noise.seen)))
