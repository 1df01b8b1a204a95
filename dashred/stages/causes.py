"""Other causes than a law that acts everywhere: a sensor, the start, or a law somewhere only.

Asked where the best law is not the simulator as it is, or leaves something: every explanation is
fitted with its own start and compared by the same score (design §4.3).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.discovery.candidates import Candidate
from dashred.discovery.faults import describe, fit_fault, predicted, suspects
from dashred.discovery.free_forcing import FreeForcing, evidence, fit_free_forcing
from dashred.discovery.gauss_newton import minimise
from dashred.discovery.hypothesis import Tested, first_unknowns, test
from dashred.discovery.law import Law, law_of
from dashred.discovery.noise_model import NoiseModel
from dashred.discovery.objective import Objective
from dashred.discovery.screening import Screened, screen
from dashred.discovery.shooting import Simulator
from dashred.discovery.starts import ScaledStart
from dashred.physics.library import evaluate_terms
from dashred.physics.pulses import Pulses
from dashred.physics.system import System, Term
from dashred.progress import Report

CELLS, KNOTS = 12, 13
# A score this much worse than the best is a rival's.
RIVAL = 6.0
# Evidence that a free forcing has to gain for something to be missing (design §4.3.8).
MISSING = 4.0
# Faults that are fitted, of those that the linearised problem says explain something.
FAULTS = 4
# By how much the start may lie outside of its prior.
WIDER = (3.0, 6.0)
# Hypotheses that are fitted, of which so many to the end; of one kind and law not more than two.
TRIED, FINALISTS, ALIKE = 24, 8, 2
FIRST_STEPS, FIRST_TOLERANCE = 3, 1e-2
LAST_STEPS, LAST_TOLERANCE = 10, 1e-4
# Those whose score is farther than this from the best after the first steps are given up.
HOPELESS = 60.0


@dataclass(frozen=True)
class Cause:
    """An explanation, and where it was fitted.

    Attributes:
        law: the explanation.
        objective: F, in its own unknowns.
        phi: its minimum.
    """

    law: Law
    objective: Objective
    phi: Tensor


def weigh(
    everything: Objective,
    everywhere: int,
    best: Cause,
    null: Cause,
    size: Tensor,
    compiled: Callable[[], Simulator],
    report: Report,
) -> tuple[list[Law], float]:
    """Return other explanations, and by how much the evidence is for more than the best of all.

    Args:
        everything: F of all candidates over the whole record.
        everywhere: how many of the candidates, the first, may act everywhere.
        best: the best law that acts everywhere.
        null: the simulator as it is.
        size: rms of each equation's own tendency, ``(equation,)``.
        compiled: the simulator with windows in reach: worth its seconds only if they are needed.
        report: progress.
    """
    forced, gain = force(best.objective, best.phi, size)
    report(0.2, f"a free forcing gains {gain:.0f}")
    if gain > MISSING:
        forced, _ = force(null.objective, null.phi, size)
        noise = _noise_under(forced)
        everything = replace(everything, noise=noise)
        best, null = _again(best, noise), _again(null, noise)
    found = [best.law, null.law, *faults(null.objective, null.phi, best.law.score + RIVAL)]
    if best.law.candidates or gain > MISSING:
        found += wider_starts(null.objective, null.phi)
    report(0.4, f"{len(found) - 2} faults and starts fitted")
    explained = min(found, key=lambda law: law.score)
    if explained.fault is not None or explained.widened > 1:
        return found, 0.0
    if gain > MISSING:
        shooting = replace(everything.shooting, simulator=compiled())
        whole = replace(everything, shooting=shooting)
        local = local_laws(whole, everywhere, forced, null.law.score)
        found += [cause.law for cause in local]
        first = min([best, *local], key=lambda cause: cause.law.score)
        _, gain = force(first.objective, first.phi, size)
    return found, gain


def _noise_under(forced: FreeForcing) -> NoiseModel:
    """Return the noise that is left under a free forcing: no wrong law has a part in it."""
    objective, phi = forced.objective, forced.phi
    [readings] = objective.shooting.readings(*objective.split(phi[None]))
    normal = objective.linearise(phi, readings)
    information = normal.hessian - torch.diag(normal.precision)
    spent = float(torch.linalg.solve(normal.hessian, information).trace())
    return replace(objective.noise_left(readings, round(spent)), seen=objective.noise.seen)


def _again(cause: Cause, noise: NoiseModel) -> Cause:
    """Return an explanation fitted under another noise."""
    mine = replace(cause.objective, noise=noise)
    fitted = minimise(mine, cause.phi, LAST_STEPS, LAST_TOLERANCE)
    [old], _ = cause.objective.values(cause.phi[None])
    score = cause.law.score - float(old) + fitted.cost
    return Cause(law_of(mine, fitted, cause.law.candidates, score), mine, fitted.phi)


def faults(objective: Objective, phi: Tensor, bound: float) -> list[Law]:
    """Return what a fault of one sensor explains.

    Args:
        objective: F of the start alone.
        phi: its minimum.
        bound: faults that are predicted to score worse are left out.
    """
    normal = objective.linearise(phi)
    [states] = objective.shooting.states(*objective.split(phi[None]))
    scored = [(predicted(objective, normal, f, states), f) for f in suspects(objective, normal)]
    chosen = sorted((pair for pair in scored if pair[0] < bound), key=lambda pair: pair[0])
    found = []
    for _, fault in chosen[:FAULTS]:
        tested = fit_fault(objective, fault, phi)
        law = law_of(tested.objective, tested.fitted, (), tested.score)
        found.append(replace(law, fault=describe(objective, tested)))
    return found


def wider_starts(objective: Objective, phi: Tensor) -> list[Law]:
    """Return what a start outside of its prior explains, by Laplace's evidence.

    A wider prior lets F fall in any case: what it may move more is held against it.

    Args:
        objective: F of the start alone.
        phi: its minimum.
    """
    every = range(len(phi))
    [cost], _ = objective.values(phi[None])
    plain = evidence(objective.linearise(phi), every) - float(cost)
    found = []
    for factor in WIDER:
        shooting = objective.shooting
        wide = replace(shooting, start=ScaledStart(shooting.start, factor))
        mine = replace(objective, shooting=wide)
        fitted = minimise(mine, phi / factor, LAST_STEPS, LAST_TOLERANCE)
        volume = evidence(mine.linearise(fitted.phi, fitted.readings), every) - fitted.cost
        law = law_of(mine, fitted, (), fitted.cost + volume - plain)
        found.append(replace(law, widened=factor))
    return found


def force(objective: Objective, phi: Tensor, size: Tensor) -> tuple[FreeForcing, float]:
    """Return a free forcing on top of a law, and by how much the evidence is for it.

    Args:
        objective: F of a law, or of none.
        phi: its minimum.
        size: rms of each equation's own tendency, ``(equation,)``.
    """
    shooting = objective.shooting
    cells = CELLS if shooting.simulator.system.axes else 1
    pulses = Pulses.over(shooting.simulator.system, shooting.times, cells, KNOTS)
    forced = fit_free_forcing(objective, phi, pulses, size, range(len(size)))
    before = evidence(objective.linearise(phi), range(len(phi)))
    return forced, before - forced.evidence


def local_laws(
    objective: Objective, everywhere: int, forced: FreeForcing, nothing: float
) -> list[Cause]:
    """Return laws that act somewhere only, and others that screening finds.

    Args:
        objective: F of all candidates, its simulator with windows in reach.
        everywhere: how many of these, the first, may act everywhere.
        forced: a free forcing that explains the recording without a law.
        nothing: score of the simulator as it is.
    """
    shooting = forced.objective.shooting
    [states] = shooting.states(*forced.objective.split(forced.phi[None]))
    screened = screen(objective, everywhere, forced, states)
    chosen = _various(sorted(screened, key=lambda found: found.cost + _penalty(objective, found)))
    z = forced.phi[: objective.modes]
    tried = [_try(objective, found, z) for found in chosen]
    best = min(tested.score for tested in tried)
    kept = [tested for tested in tried if tested.score < min(best + HOPELESS, nothing)]
    kept = sorted(kept, key=lambda tested: tested.score)[:FINALISTS]
    return [_finish(tested) for tested in kept]


def tendency_size(system: System, states: Tensor, t: float) -> Tensor:
    """Return the rms of each equation's own tendency over a simulation, ``(equation,)``."""
    own = [Term(field, system.equations[field]) for field in system.fields]
    return evaluate_terms(system, own, states, t).flatten(1).square().mean(dim=1).sqrt()


def _various(ranked: Iterable[Screened]) -> list[Screened]:
    """Return the best, but of one kind and law not more than a few."""
    counts: dict[object, int] = {}
    chosen = []
    for found in ranked:
        h = found.hypothesis
        alike = h.kind, h.everywhere, h.inside
        counts[alike] = counts.get(alike, 0) + 1
        if counts[alike] <= ALIKE:
            chosen.append(found)
        if len(chosen) == TRIED:
            break
    return chosen


def _penalty(objective: Objective, found: Screened) -> float:
    fields = len(objective.shooting.simulator.system.fields)
    count = len(objective.prior_std)
    return found.hypothesis.penalty(objective.noise.effective_count, count, fields)


def _try(objective: Objective, found: Screened, z: Tensor) -> Tested:
    begin = first_unknowns(z, found.coefficients, found.hypothesis.guess)
    penalty = _penalty(objective, found)
    return test(objective, found.hypothesis, begin, FIRST_STEPS, FIRST_TOLERANCE, penalty)


def _finish(tested: Tested) -> Cause:
    mine, before = tested.objective, tested.fitted
    fitted = minimise(mine, before.phi, LAST_STEPS, LAST_TOLERANCE)
    score = tested.score - before.cost + fitted.cost
    done = replace(tested, fitted=fitted, score=score)
    guess = tested.hypothesis.guess
    edges = len(guess.values) if guess else 0
    return Cause(law_of(mine, fitted, done.candidates, score, edges), mine, fitted.phi)


def unlike(laws: Sequence[Law]) -> list[Law]:
    """Return the laws, the best first, of several with the same candidates in like windows one."""
    kept: dict[object, Law] = {}
    for law in sorted(laws, key=lambda law: law.score):
        kept.setdefault(_form(law), law)
    return list(kept.values())


def _form(law: Law) -> object:
    parts = tuple(sorted(_form_of(candidate) for candidate in law.candidates))
    fault = (law.fault.kind, law.fault.sensor) if law.fault else None
    return parts, fault, law.widened


def _form_of(candidate: Candidate) -> tuple[str, str, str]:
    window = candidate.window
    return candidate.key, *((window.shape.kind, window.shape.of) if window else ("", ""))
