"""Evidence for a law where the noise is correlated from sample to sample.

A search over segments takes the noise as white. If the residuals of its law are not, a reading says
less than an independent one, and terms that follow the noise gain too much. Under noise with
``r_t = ρ r_{t-1} + e_t`` in each sensor, with the variance v of the residuals and ρ estimated for
each law::

    -2 ln p(y) = Σ_sensors n ln(v (1 - ρ²)) + k (ln n + 2 ln p) + price of forces and sensor errors

(Box, Jenkins & Reinsel, *Time Series Analysis*, chapter 7).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dashred.inference.segments.gauss_newton import NodeFit
from dashred.inference.segments.segments import Array
from dashred.inference.segments.selection.candidate_sets import Set
from dashred.inference.segments.selection.set_selection import term_price
from dashred.inference.segments.weak_constraint import SMALLEST_LEVEL, WeakConstraintProblem

# Neighbouring residuals that are correlated by less count as independent, and also if the
# correlation is below this many of its standard deviations.
CORRELATED, BY_CHANCE, LARGEST = 0.3, 2.0, 0.99


@dataclass(frozen=True)
class ResidualMoments:
    """Moments of the residuals of a law.

    Attributes:
        counts: number of readings, ``(sensor,)``.
        variance: mean square residual, in units of the assumed σ², ``(sensor,)``.
        correlation: ρ of neighbouring residuals, 0 where they count as independent, ``(sensor,)``.
    """

    counts: Array
    variance: Array
    correlation: Array

    @property
    def redundancy(self) -> float:
        """How many readings say as much as an independent one: the mean of (1 + ρ)/(1 - ρ)."""
        each = (1 + self.correlation) / (1 - self.correlation)
        return float(np.average(each, weights=np.maximum(self.counts, 1e-300)))


def residual_moments(problem: WeakConstraintProblem, members: Set, fit: NodeFit) -> ResidualMoments:
    """Return the moments of the residuals of a fitted law.

    Args:
        problem: F under which it was fitted.
        members: its candidates.
        fit: the fit.
    """
    segments = problem.segments
    predicted = problem.read(problem.states(fit.point, members), fit.point, members)
    apart = np.where(segments.noisy, (predicted - segments.readings) / problem.noise_stds, np.nan)
    episodes = [segments.join(apart, episode) for episode in range(len(segments.begins))]
    joined = np.concatenate(episodes)
    counts = np.isfinite(joined).sum(axis=0)
    least = np.maximum(np.square(problem.least_std / problem.noise_std), SMALLEST_LEVEL)
    variance = np.nansum(np.square(joined), axis=0) / np.maximum(counts, 1)

    before = np.concatenate([episode[:-1] for episode in episodes])
    after = np.concatenate([episode[1:] for episode in episodes])
    products, power = before * after, (before**2 + after**2) / 2
    correlation = np.nansum(products, axis=0) / np.maximum(np.nansum(power, axis=0), 1e-300)
    limit = np.maximum(CORRELATED, BY_CHANCE / np.sqrt(np.maximum(counts, 1)))
    correlation = np.where(correlation > limit, np.minimum(correlation, LARGEST), 0.0)
    return ResidualMoments(counts, np.maximum(variance, least), correlation)


def correlated_score(
    problem: WeakConstraintProblem, members: Set, fit: NodeFit, price: float
) -> float:
    """Return ``-2 ln p(y)`` of a law up to a constant; infinite if it cannot be fitted.

    Args:
        problem: F under which it was fitted.
        members: its candidates.
        fit: the fit.
        price: of the forces and sensor errors beside it.
    """
    if not math.isfinite(fit.cost):
        return math.inf
    moments = residual_moments(problem, members, fit)
    counts, variance = moments.counts, moments.variance
    likelihood = float(counts @ np.log(variance * (1 - moments.correlation**2)))
    # The part of F that the model error and the priors have, in units of the noise. The model error
    # follows the noise, so it is correlated as well.
    unit = problem.level([fit.cost]) * moments.redundancy
    priors = (fit.cost - float(counts @ variance)) / unit
    return likelihood + priors + term_price(problem) * len(members) + price
