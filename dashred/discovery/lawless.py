"""Explanations without a law: a sensor at fault, or a start that lies outside of its prior."""

from __future__ import annotations

from dataclasses import replace

from dashred.discovery.cause import Cause
from dashred.discovery.faults import describe_fitted, fit_fault, predicted_faults
from dashred.discovery.free_forcing import evidence
from dashred.discovery.gauss_newton import minimise
from dashred.discovery.law import law_of
from dashred.discovery.starts import ScaledStart
from dashred.discovery.suspects import suspects

# Faults that are fitted, of those that the linearised problem says explain something.
FAULTS = 4
# By how much the start may lie outside of its prior.
WIDER = (3.0, 6.0)
STEPS, TOLERANCE = 10, 1e-4


def faults(cause: Cause, bound: float) -> list[Cause]:
    """Return what a fault of one sensor explains, beside a law or without one.

    Args:
        cause: a law that acts everywhere, or the simulator as it is.
        bound: faults that are predicted to score worse are left out.
    """
    objective, phi = cause.objective, cause.phi
    [cost], _ = objective.values(phi[None])
    freedom, normal = cause.law.score - float(cost), cause.normal
    every = predicted_faults(objective, phi, normal, suspects(objective, normal))
    near = [pair for pair in every if pair[0].score + freedom < bound]
    chosen = sorted(near, key=lambda pair: pair[0].score)
    found = []
    for best, fault in chosen[:FAULTS]:
        tested = fit_fault(objective, fault, phi, best.own)
        candidates = objective.shooting.candidates
        law = law_of(tested.objective, tested.fitted, candidates, tested.score + freedom)
        law = replace(law, fault=describe_fitted(objective, tested))
        found.append(Cause(law, tested.objective, tested.fitted.phi))
    return found


def wider_starts(null: Cause) -> list[Cause]:
    """Return what a start outside of its prior explains, by Laplace's evidence.

    A wider prior lets F fall in any case: what it may move more is held against it. Factors that
    the linearised problem holds nothing of are not tried.

    Args:
        null: the simulator as it is.
    """
    objective, phi, normal = null.objective, null.phi, null.normal
    every = range(len(phi))
    linear = evidence(normal, every)
    [cost], _ = objective.values(phi[None])
    plain = linear - float(cost)
    found = []
    for factor in WIDER:
        if evidence(replace(normal, precision=normal.precision / factor**2), every) > linear:
            continue
        shooting = objective.shooting
        wide = replace(shooting, start=ScaledStart(shooting.start, factor))
        mine = replace(objective, shooting=wide)
        fitted = minimise(mine, phi / factor, STEPS, TOLERANCE)
        there = mine.linearise(fitted.phi, fitted.readings)
        volume = evidence(there, every) - fitted.cost
        law = law_of(mine, fitted, (), fitted.cost + volume - plain)
        found.append(Cause(replace(law, widened=factor), mine, fitted.phi))
    return found
