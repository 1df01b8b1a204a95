"""The hypothesis of an initial state outside its prior."""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.least_squares import NormalEquations
from dashred.inference.hypotheses.forcing_levels import evidence
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit, fit_growing_horizon
from dashred.inference.hypotheses.sensors.chance_of_start import chance_of_start
from dashred.inference.initial_state.start_models import ScaledStart

# Factors by which the prior of the initial state may be wider, and rounds of choosing one.
FACTORS, MAX_ROUNDS = (2.5, 3.2, 4.0, 5.0, 6.4, 8.0), 2


def fit_start_hypotheses(null: HypothesisFit, bound: float = math.inf) -> list[HypothesisFit]:
    """Return the hypothesis of an initial state outside its prior, or none.

    F always decreases under a wider prior. The score therefore contains the Laplace evidence of the
    wider prior and a penalty for the factor. The linearised problem gives the factor.

    Args:
        null: the uncorrected simulator.
        bound: a fit with a worse F is not repeated over a growing horizon.
    """
    objective, phi, normal = null.objective, null.phi, null.normal
    start = objective.forward_model.start
    size, points = start.size, math.prod(objective.forward_model.simulator.system.grid.shape)
    factor = _best_factor(normal, size, 1.0)
    if _evidence_of_factor(normal, size, factor) > _evidence_of_factor(normal, size, 1.0):
        return []
    z = _scaled(phi, size, 1 / factor)
    for _ in range(MAX_ROUNDS):
        problem = objective.with_start(ScaledStart(start, factor))
        fitted = fit_growing_horizon(problem, z, bound)
        normal_there = problem.linearise(fitted.phi, fitted.readings)
        previous, factor = factor, _best_factor(normal_there, size, factor)
        if factor == previous:
            break
        z = _scaled(fitted.phi, size, previous / factor)
    precision = _scaled(normal_there.precision, size, previous**2)
    plain = normal_there.with_precision(precision)
    wide_penalty = _penalty_part(_mean_evidence(normal_there, size, previous), normal_there)
    plain_penalty = _penalty_part(_evidence_of_factor(plain, size, 1.0), plain)
    penalty = wide_penalty - plain_penalty
    score = fitted.cost + penalty + math.log(objective.noise.effective_count)
    law = replace(
        build_law(problem, fitted, score, normal_there),
        start_prior_factor=previous,
        start_chance=chance_of_start(start, previous * fitted.phi[:size], points),
    )
    return [HypothesisFit(law, problem, fitted.phi)]


def _scaled(values: Tensor, size: int, factor: float) -> Tensor:
    """Return values of all unknowns with those of the start, the first ones, scaled."""
    return torch.cat([factor * values[:size], values[size:]])


def _mean_evidence(normal: NormalEquations, size: int, factor: float) -> float:
    """Return the evidence averaged over all factors, about a fit under one of them.

    It is averaged because the best of many does well by chance.
    """
    values = [_evidence_of_factor(normal, size, wider / factor) for wider in FACTORS]
    least = min(values)
    shares = sum(math.exp((least - value) / 2) for value in values) / len(values)
    return least - 2 * math.log(shares)


def _penalty_part(value: float, normal: NormalEquations) -> float:
    """Return the part of an evidence that is not the minimum of F: the penalty."""
    return value - normal.minimum()


def _best_factor(normal: NormalEquations, size: int, factor: float) -> float:
    """Return the factor of the prior with the best evidence, about a fit under a given factor."""
    return min(FACTORS, key=lambda wider: _evidence_of_factor(normal, size, wider / factor))


def _evidence_of_factor(normal: NormalEquations, size: int, factor: float) -> float:
    """Return the evidence of a prior of the start, of so many modes, that is wider by a factor."""
    wide = normal.with_precision(_scaled(normal.precision, size, factor**-2))
    return evidence(wide, range(len(normal.phi)))
