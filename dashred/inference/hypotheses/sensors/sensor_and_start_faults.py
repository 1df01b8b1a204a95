"""Hypotheses that add no term: a sensor fault, or an initial state outside its prior."""

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
from dashred.inference.hypotheses.sensors.faults import FittedFault, fit_fault, predict_faults
from dashred.inference.hypotheses.sensors.suspected_faults import find_suspected_faults
from dashred.inference.initial_state.start_models import ScaledStart

# Number of faults that are fitted, the best by the linearised problem first. MAX_REFITS of them may
# be refitted over a growing horizon if they reduce the misfit below MAX_MISFIT_SHARE.
MAX_FAULTS, MAX_REFITS, MAX_MISFIT_SHARE = 4, 2, 0.5
# Factors by which the prior of the initial state may be wider, and rounds of choosing one.
FACTORS, MAX_ROUNDS = (2.5, 3.2, 4.0, 5.0, 6.4, 8.0), 2
STEPS, TOLERANCE = 10, 1e-4
# Tolerance of a fit that leaves far more than noise.
ROUGH_TOLERANCE = 0.02
# A fit with a larger χ²/n is repeated over a growing horizon, which begins with FIRST_SAMPLES.
MAX_CHI2, FIRST_SAMPLES = 1.5, 6


def fit_sensor_hypotheses(fit: HypothesisFit, bound: float) -> list[HypothesisFit]:
    """Return the hypotheses that add a fault of one sensor to a fit.

    Args:
        fit: a law that acts everywhere, or the uncorrected simulator.
        bound: faults with a worse predicted score are not fitted.
    """
    objective, phi = fit.objective, fit.phi
    [cost], _ = objective.values(phi[None])
    penalty, normal = fit.law.score - float(cost), fit.normal
    faults = find_suspected_faults(objective, normal)
    predictions = predict_faults(objective, phi, normal, faults)
    plausible = [pair for pair in predictions if pair[0].score + penalty < bound]
    chosen = sorted(plausible, key=lambda pair: pair[0].score)[:MAX_FAULTS]
    fitted_faults = [fit_fault(objective, fault, phi, best.parameters) for best, fault in chosen]
    fitted_faults.sort(key=lambda fitted_fault: fitted_fault.score)
    refitted = [_refit_poor_fault(fault, fit.law) for fault in fitted_faults[:MAX_REFITS]]
    fits = []
    for fitted_fault in [*refitted, *fitted_faults[MAX_REFITS:]]:
        law = build_law(fitted_fault.objective, fitted_fault.fitted, fitted_fault.score + penalty)
        law = replace(law, fault=fitted_fault_in_units(objective, fitted_fault))
        fits.append(HypothesisFit(law, fitted_fault.objective, fitted_fault.fitted.phi))
    return fits


def _refit_poor_fault(fitted_fault: FittedFault, without: Law) -> FittedFault:
    """Refit a fault that explains most of the misfit but leaves more than noise.

    The faulty sensor may have led the first fit far from the right minimum.
    """
    previous, count = fitted_fault.fitted, fitted_fault.objective.noise.count
    if not MAX_CHI2 < previous.chi2 / count < MAX_MISFIT_SHARE * without.chi2:
        return fitted_fault
    fitted = _fit_with_growing_horizon(fitted_fault.objective, previous.phi, math.inf)
    return replace(
        fitted_fault, fitted=fitted, score=fitted_fault.score + fitted.cost - previous.cost
    )


def fit_start_hypotheses(null: HypothesisFit, bound: float = math.inf) -> list[HypothesisFit]:
    """Return the hypothesis of an initial state outside its prior, or none.

    F always decreases under a wider prior. The score therefore contains the Laplace evidence of the
    wider prior and a penalty for the factor. The linearised problem gives the factor.

    Args:
        null: the uncorrected simulator.
        bound: a fit with a worse F is not repeated over a growing horizon.
    """
    objective, phi, normal = null.objective, null.phi, null.normal
    factor = _best_factor(normal, 1.0)
    if _evidence_of_factor(normal, factor) > _evidence_of_factor(normal, 1.0):
        return []
    z, start = phi / factor, objective.forward_model.start
    for _ in range(MAX_ROUNDS):
        problem = objective.with_start(ScaledStart(start, factor))
        fitted = _fit_with_growing_horizon(problem, z, bound)
        normal_there = problem.linearise(fitted.phi, fitted.readings)
        previous, factor = factor, _best_factor(normal_there, factor)
        if factor == previous:
            break
        z = fitted.phi * previous / factor
    plain = replace(normal_there, precision=normal_there.precision * previous**2)
    wide_penalty = _penalty_part(_mean_evidence(normal_there, previous), normal_there)
    plain_penalty = _penalty_part(_evidence_of_factor(plain, 1.0), plain)
    penalty = wide_penalty - plain_penalty
    score = fitted.cost + penalty + math.log(objective.noise.effective_count)
    law = replace(build_law(problem, fitted, score, normal_there), start_prior_factor=previous)
    return [HypothesisFit(law, problem, fitted.phi)]


def _fit_with_growing_horizon(objective: LeastSquaresProblem, z: Tensor, bound: float) -> FitResult:
    """Fit from the given unknowns; if that leaves more than noise, also over a growing horizon.

    A fit under a narrow prior may end in a minimum from which the right one cannot be reached. F
    increases with the number of samples, so a fit above the bound is given up early.
    """
    fitted = _fit_start(objective, z)
    if not _is_poor(objective, fitted):
        return fitted
    begin = torch.zeros_like(z)
    for grown in growing_horizon_fits(objective, begin, FIRST_SAMPLES):
        if grown.cost > bound:
            return fitted
        begin = grown.phi
    return min(fitted, _fit_start(objective, begin), key=lambda each: each.cost)


def _fit_start(objective: LeastSquaresProblem, z: Tensor) -> FitResult:
    """Fit with a rough tolerance, then until convergence if no more than noise is left."""
    fitted = minimise(objective, z, STEPS, ROUGH_TOLERANCE)
    if _is_poor(objective, fitted):
        return fitted
    return minimise(objective, fitted.phi, STEPS, TOLERANCE)


def _is_poor(objective: LeastSquaresProblem, fitted: FitResult) -> bool:
    """Tell whether a fit leaves more than noise."""
    return not fitted.chi2 < MAX_CHI2 * objective.noise.count


def _mean_evidence(normal: NormalEquations, factor: float) -> float:
    """Return the evidence averaged over all factors, about a fit under one of them.

    It is averaged because the best of many does well by chance.
    """
    values = [_evidence_of_factor(normal, wider / factor) for wider in FACTORS]
    least = min(values)
    shares = sum(math.exp((least - value) / 2) for value in values) / len(values)
    return least - 2 * math.log(shares)


def _penalty_part(value: float, normal: NormalEquations) -> float:
    """Return the part of an evidence that is not the minimum of F: the penalty."""
    return value - normal.minimum()


def _best_factor(normal: NormalEquations, factor: float) -> float:
    """Return the factor of the prior with the best evidence, about a fit under a given factor."""
    return min(FACTORS, key=lambda wider: _evidence_of_factor(normal, wider / factor))


def _evidence_of_factor(normal: NormalEquations, factor: float) -> float:
    """Return the evidence of a prior that is wider by a factor."""
    wide = replace(normal, precision=normal.precision / factor**2)
    return evidence(wide, range(len(normal.phi)))
