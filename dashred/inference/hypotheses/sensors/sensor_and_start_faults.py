"""Explanations without a law: a sensor at fault, or a start that lies outside of its prior."""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from dashred.inference.fit.law import Law, build_law
from dashred.inference.fit.least_squares import LeastSquaresProblem, NormalEquations
from dashred.inference.fit.levenberg_marquardt import FitResult, growing_horizon_fits, minimise
from dashred.inference.hypotheses.free_forcing import evidence
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from dashred.inference.hypotheses.sensors.fault_in_units import fitted_fault_in_units
from dashred.inference.hypotheses.sensors.faults import FittedFault, fit_fault, predicted_faults
from dashred.inference.hypotheses.sensors.suspects import suspects
from dashred.inference.initial_state.start_models import ScaledStart

# Faults that are fitted, of those that the linearised problem says explain something; of which so
# many are fitted on, where they leave less than this share of the misfit.
FAULTS, FURTHER, MOST = 4, 2, 0.5
# By how much the start may lie outside of its prior, and how often that is asked.
WIDER, ROUNDS = (2.5, 3.2, 4.0, 5.0, 6.4, 8.0), 2
STEPS, TOLERANCE = 10, 1e-4
# A step that gains a smaller share of F ends a fit that leaves far more than noise.
ROUGH = 0.02
# What leaves so many times the noise's squares is looked for anew, from so many samples on.
FAR, FIRST = 1.5, 6


def sensor_hypotheses(cause: HypothesisFit, bound: float) -> list[HypothesisFit]:
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
    chosen = sorted(near, key=lambda pair: pair[0].score)[:FAULTS]
    tests = [fit_fault(objective, fault, phi, best.own) for best, fault in chosen]
    tests.sort(key=lambda tested: tested.score)
    found = []
    for tested in [*(_fitted_on(t, cause.law) for t in tests[:FURTHER]), *tests[FURTHER:]]:
        law = build_law(tested.objective, tested.fitted, tested.score + freedom)
        law = replace(law, fault=fitted_fault_in_units(objective, tested))
        found.append(HypothesisFit(law, tested.objective, tested.fitted.phi))
    return found


def _fitted_on(tested: FittedFault, without: Law) -> FittedFault:
    """Return a fault that explains most, and leaves more than noise, fitted on.

    The sensor may have led what was fitted to it far from where it belongs.
    """
    before, count = tested.fitted, tested.objective.noise.count
    if not FAR < before.chi2 / count < MOST * without.chi2:
        return tested
    fitted = _anywhere(tested.objective, before.phi, math.inf)
    return replace(tested, fitted=fitted, score=tested.score + fitted.cost - before.cost)


def start_hypotheses(null: HypothesisFit, bound: float = math.inf) -> list[HypothesisFit]:
    """Return what a start outside of its prior explains, by Laplace's evidence; or nothing.

    A wider prior lets F fall in any case: what it may move more is held against it, and that one
    more number is told. How much wider it is, the linearised problem tells, about the plain prior's
    fit first.

    Args:
        null: the simulator as it is.
        bound: what scores worse is not looked for anew.
    """
    objective, phi, normal = null.objective, null.phi, null.normal
    factor = _likeliest(normal, 1.0)
    if _widened(normal, factor) > _widened(normal, 1.0):
        return []
    z, start = phi / factor, objective.forward_model.start
    for _ in range(ROUNDS):
        mine = objective.with_start(ScaledStart(start, factor))
        fitted = _anywhere(mine, z, bound)
        there = mine.linearise(fitted.phi, fitted.readings)
        before, factor = factor, _likeliest(there, factor)
        if factor == before:
            break
        z = fitted.phi * before / factor
    plain = replace(there, precision=there.precision * before**2)
    cost = _volume(_over_all(there, before), there) - _volume(_widened(plain, 1.0), plain)
    score = fitted.cost + cost + math.log(objective.noise.effective_count)
    law = replace(build_law(mine, fitted, score, there), start_prior_factor=before)
    return [HypothesisFit(law, mine, fitted.phi)]


def _anywhere(objective: LeastSquaresProblem, z: Tensor, bound: float) -> FitResult:
    """Fit from where it is, and where that leaves more than noise, from the first samples.

    What was fitted under a prior that keeps it away may have no way to where it belongs. Over more
    samples F is larger: what is beyond the bound over the first stays there.
    """
    fitted = _fitted(objective, z)
    if not _far(objective, fitted):
        return fitted
    begin = torch.zeros_like(z)
    for found in growing_horizon_fits(objective, begin, FIRST):
        if found.cost > bound:
            return fitted
        begin = found.phi
    return min(fitted, _fitted(objective, begin), key=lambda found: found.cost)


def _fitted(objective: LeastSquaresProblem, z: Tensor) -> FitResult:
    """Fit roughly, and to the end if that leaves no more than noise."""
    fitted = minimise(objective, z, STEPS, ROUGH)
    if _far(objective, fitted):
        return fitted
    return minimise(objective, fitted.phi, STEPS, TOLERANCE)


def _far(objective: LeastSquaresProblem, fitted: FitResult) -> bool:
    """Tell whether a fit leaves more than noise."""
    return not fitted.chi2 < FAR * objective.noise.count


def _over_all(normal: NormalEquations, factor: float) -> float:
    """Return the evidence over all factors, none preferred, about a fit under one of them.

    The best of many would be found evident by chance.
    """
    every = [_widened(normal, wider / factor) for wider in WIDER]
    least = min(every)
    shares = sum(math.exp((least - found) / 2) for found in every) / len(every)
    return least - 2 * math.log(shares)


def _volume(found: float, normal: NormalEquations) -> float:
    """Return what of an evidence is not F's minimum: what freedom costs."""
    return found - normal.minimum()


def _likeliest(normal: NormalEquations, factor: float) -> float:
    """Return how much wider the prior is by the evidence, about a fit under so much of it."""
    return min(WIDER, key=lambda wider: _widened(normal, wider / factor))


def _widened(normal: NormalEquations, factor: float) -> float:
    """Return the evidence of a start whose prior is so many times as wide."""
    wide = replace(normal, precision=normal.precision / factor**2)
    return evidence(wide, range(len(normal.phi)))
