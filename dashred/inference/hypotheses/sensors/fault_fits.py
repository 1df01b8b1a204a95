"""Hypotheses that add faults of sensors to a law, fitted through the simulator."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce

import torch
from torch import Tensor

from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.independent_fits import Fit, fit_all
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import FitResult, minimise
from dashred.inference.hypotheses.hypothesis_fit import (
    REJECTION_MARGIN,
    HypothesisFit,
    fit_growing_horizon,
)
from dashred.inference.sensor_faults.fault import Fault, choice_penalty
from dashred.inference.sensor_faults.fault_search import (
    FaultProblem,
    FaultSet,
    costs_without_worst,
    find_faults,
    largest_count,
    without_samples,
)
from dashred.inference.sensor_faults.fault_table import SEARCHED_KINDS
from dashred.inference.sensor_faults.faults_in_units import faults_in_units

# Number of fault sets that are fitted, the best by the linearised problem first. MAX_REFITS of them
# may be refitted over a growing horizon if they reduce the misfit below MAX_MISFIT_SHARE.
MAX_FITS, MAX_REFITS, MAX_MISFIT_SHARE = 4, 2, 0.5
# Fault sets whose predicted score exceeds the best by more than REJECTION_MARGIN and by more than
# this share of F are not fitted. A large F means that the linearised problem is inaccurate.
MARGIN_SHARE = 0.1
# Number of times that the faults are searched again about the best fit with faults.
ROUNDS = 3
STEPS, TOLERANCE = 6, 1e-3
# A fit with a larger χ²/n is repeated over a growing horizon.
MAX_CHI2 = 1.5


@dataclass(frozen=True)
class FittedFaults:
    """Faults that were fitted together with the initial state and the law.

    Attributes:
        found: the faults as predicted.
        objective: F, without the samples that are not readings, with the parameters of the faults.
        fitted: the minimum of F.
    """

    found: FaultSet
    objective: LeastSquaresProblem
    fitted: FitResult

    @property
    def score(self) -> float:
        """``F + constants + penalty``."""
        return self.fitted.cost + self.found.constant + self.found.penalty


def fit_sensor_hypotheses(fit: HypothesisFit, bound: float) -> list[HypothesisFit]:
    """Return the hypotheses that add faults of one or several sensors to a fit.

    Args:
        fit: a law that acts everywhere, or the uncorrected simulator.
        bound: faults with a worse predicted score are not fitted, except for the best ones if they
            explain most of the misfit: the fit may have been dragged far by a faulty sensor.
    """
    objective, phi = fit.objective, fit.phi
    [cost], _ = objective.values(phi[None])
    penalty = fit.law.score - float(cost)
    problem = FaultProblem.at(objective, phi, fit.normal)
    bound, dragged = bound - penalty, MAX_MISFIT_SHARE * float(cost)
    predicted = _predict(problem, bound, dragged)
    if not predicted:
        return []
    limit = predicted[0].score + max(REJECTION_MARGIN, MARGIN_SHARE * predicted[0].cost)
    chosen = [
        found
        for rank, found in enumerate(predicted[:MAX_FITS])
        if found.score < min(limit, bound) or (not rank and found.cost < dragged)
    ]
    fits = sorted(fit_fault_sets(objective, chosen, phi, bound), key=_score)
    fits[:MAX_REFITS] = [_refit_if_poor(each, fit.law.chi2, bound) for each in fits[:MAX_REFITS]]
    fits += _search_again(objective, fits, bound)
    return [_hypothesis(each, penalty) for each in fits]


def _predict(problem: FaultProblem, bound: float, dragged: float = 0.0) -> list[FaultSet]:
    """Return the faults of single sensors, and the best faults of several, the best first.

    Args:
        problem: a problem without faults.
        bound: score that faults have to fall below.
        dragged: misfit below which a fit may have been dragged by the faulty sensors; by default
            it has not been.
    """
    count = _useful_count(problem, bound, dragged)
    if not count:
        return []
    sensors = range(problem.objective.recorded.shape[1])
    found = [each.faults for each in problem.add_each(sensors, SEARCHED_KINDS)]
    if found and count > 1 and found[0].score < problem.faults.score:
        several = find_faults(problem, sensors, SEARCHED_KINDS, count)
        found += [several] if len(several.faults) > 1 else []
    return sorted(found, key=lambda each: each.score)


def _useful_count(problem: FaultProblem, bound: float, dragged: float) -> int:
    """Return the largest number of faults that may be needed; 0 if no number of them is enough.

    If no faults reach the bound, the fewest that may have dragged the fit are searched. Where a law
    is missing from a chaotic system, any number of faults lowers the misfit, and none explains it.
    """
    most = largest_count(problem.objective)
    costs = costs_without_worst(problem, most)
    choice = choice_penalty(problem.objective.recorded.shape[1])
    useful = [count for count in range(1, most + 1) if costs[count] + count * choice <= bound]
    if useful:
        return useful[-1]
    return next((count for count in range(1, most + 1) if costs[count] <= dragged), 0)


def _search_again(
    objective: LeastSquaresProblem, fits: list[FittedFaults], bound: float
) -> list[FittedFaults]:
    """Search faults about the trajectory of the best fit with faults, until they are the same."""
    tried, further = {each.found.key for each in fits}, list[FittedFaults]()
    for _ in range(ROUNDS if fits else 0):
        best = min([*fits, *further], key=_score)
        phi = best.fitted.phi[: objective.modes + len(objective.prior_std)]
        problem = FaultProblem.at(objective, phi, objective.linearise(phi))
        found = next(iter(_predict(problem, bound)), None)
        if found is None or found.key in tried or found.score >= best.score:
            break
        tried.add(found.key)
        further.append(fit_faults(objective, found, phi))
    return further


def fit_faults(objective: LeastSquaresProblem, found: FaultSet, phi: Tensor) -> FittedFaults:
    """Fit initial state, law and faults together; see :func:`fit_fault_sets`."""
    [fitted] = fit_fault_sets(objective, [found], phi)
    return fitted


def fit_fault_sets(
    objective: LeastSquaresProblem,
    sets: Sequence[FaultSet],
    phi: Tensor,
    bound: float = math.inf,
) -> list[FittedFaults]:
    """Fit initial state, law and faults together, for several sets of faults.

    Args:
        objective: F of the law.
        sets: the faults, with the parameters at which the fits begin.
        phi: initial state and law at which they begin, ``(unknown,)``.
        bound: a fit whose score will not fall below this is given up.

    Raises:
        OutOfTimeError: the deadline of F is over.
    """
    problems = [reduce(_with_fault, found.faults, objective) for found in sets]
    begins = [torch.cat([phi, *found.parameters]) for found in sets]
    most = [bound - found.constant - found.penalty for found in sets]
    fits = [
        Fit(problem, partial(minimise, phi=begin, steps=STEPS, tolerance=TOLERANCE, bound=cost))
        for problem, begin, cost in zip(problems, begins, most, strict=True)
    ]
    return [*map(FittedFaults, sets, problems, fit_all(fits))]


def _with_fault(objective: LeastSquaresProblem, fault: Fault) -> LeastSquaresProblem:
    """Return F with the parameters of a fault, and without the samples that it removes."""
    problem = without_samples(objective, fault)
    if fault.errors is None:
        return problem
    forward_model = problem.forward_model
    sensors = replace(forward_model.sensors, errors=(*forward_model.sensors.errors, fault.errors))
    return problem.with_unknowns(replace(forward_model, sensors=sensors), fault.errors.scales)


def _refit_if_poor(fit: FittedFaults, chi2_without: float, bound: float) -> FittedFaults:
    """Refit faults that explain most of the misfit but leave more than noise.

    A faulty sensor may have led the first fit far from the right minimum. The refit is given up
    where its score exceeds the bound.
    """
    previous, count = fit.fitted, fit.objective.noise.count
    if not MAX_CHI2 < previous.chi2 / count < MAX_MISFIT_SHARE * chi2_without:
        return fit
    most = bound - (fit.score - previous.cost)
    return replace(fit, fitted=fit_growing_horizon(fit.objective, previous.phi, most))


def _hypothesis(fit: FittedFaults, penalty: float) -> HypothesisFit:
    objective, fitted, faults = fit.objective, fit.fitted, fit.found.faults
    normal = objective.linearise(fitted.phi, fitted.readings)
    law = build_law(objective, fitted, fit.score + penalty, normal)
    law = replace(law, faults=faults_in_units(objective, faults, normal))
    return HypothesisFit(law, objective, fitted.phi, faults=faults)


def _score(fit: FittedFaults) -> float:
    return fit.score
