"""A fitted hypothesis, and refits of it: under another noise, or from several starting points."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import torch
from torch import Tensor

from dashred.core.budget import OutOfTimeError
from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.independent_fits import Fit, fit_all
from dashred.inference.fit.law import Law
from dashred.inference.fit.least_squares import LeastSquaresProblem, NormalEquations
from dashred.inference.fit.levenberg_marquardt import (
    FitResult,
    growing_horizon_fits,
    minimise,
    minimise_growing_horizon,
    minimise_in_rounds,
)
from dashred.inference.sensor_faults.fault import Fault
from dashred.inference.sensor_faults.faults_in_units import faults_in_units

STEPS, TOLERANCE = 10, 1e-4
# A hypothesis whose score exceeds the best by this much is rejected.
REJECTION_MARGIN = 60.0
# Part of the score of a law with terms beyond the library: odds of 20 to 1 against one. The best of
# many functions and waves fits the noise of a recording a little better than none.
UNLIKELY = 6.0
# Limits of one round of `refine`, and the smallest gain of F for which another round is run.
REFINE_STEPS, REFINE_TOLERANCE, MIN_GAIN = 20, 1e-5, 1.0
# Further starting points of `refine`: fits to these first shares of the record, and fits under this
# many times the noise.
HORIZON_SHARES, NOISE_FACTORS = (0.17, 0.25, 0.5), (2.0, 4.0)
# Points at which F is compared along the line from a starting point to a minimum.
PATH_POINTS = 9
# A fit with a larger χ²/n has lost the recording: no minimum nearby is right.
LOST_CHI2 = 30.0
# A fit that still has a larger χ²/n after the first round is not refined further.
POOR_CHI2 = 3.0
# `fit_growing_horizon`: tolerance of a fit that leaves far more than noise, the χ²/n above which a
# fit is repeated over a growing horizon, and the first horizon.
ROUGH_TOLERANCE, MAX_CHI2, FIRST_SAMPLES = 0.02, 1.5, 6


@dataclass(frozen=True)
class ExcludedSensors:
    """Sensors that were excluded from a fit because they may be faulty.

    Attributes:
        without_faults: the hypothesis before the faults were added.
        sensors: columns of the sensors, one of each.
        gain: decrease of F due to the faults, less their penalty, on the linearised problem. F of a
            nonlinear fit to all samples would not be comparable, because such a fit may get stuck.
    """

    without_faults: HypothesisFit
    sensors: tuple[int, ...]
    gain: float


@dataclass(frozen=True)
class HypothesisFit:
    """A hypothesis and its fit.

    Attributes:
        law: the law and the sensor faults that were fitted.
        objective: F, in its own unknowns.
        phi: its minimum, ``(unknown,)``.
        faults: the faults whose parameters are the last unknowns.
        excluded: the sensors that were excluded from the fit; None if all were used.
    """

    law: Law
    objective: LeastSquaresProblem
    phi: Tensor
    faults: tuple[Fault, ...] = ()
    excluded: ExcludedSensors | None = None

    @cached_property
    def normal(self) -> NormalEquations:
        """F linearised about its minimum; cached because it is expensive and used several times."""
        return self.objective.linearise(self.phi)


def by_score(fit: HypothesisFit) -> float:
    """Return the score of a hypothesis: a sort key, lower is better."""
    return fit.law.score


def refit(fit: HypothesisFit, objective: LeastSquaresProblem) -> HypothesisFit:
    """Refit a hypothesis under another noise or to other samples; its score changes as F does.

    Args:
        fit: the hypothesis.
        objective: F in the same unknowns.
    """
    return replace_minimum(fit, objective, minimise(objective, fit.phi, STEPS, TOLERANCE))


def refine(fit: HypothesisFit) -> HypothesisFit:
    """Refit a hypothesis from several starting points and continue from the best until convergence.

    In chaos the lowest minimum over a long record has many others around it. Some of them vanish
    under larger noise, others over a shorter record. One round of steps is run from each starting
    point that does not lead to the lowest minimum so far, and only the lowest fit is continued. A
    hypothesis that has lost the recording is returned unchanged. One that is still far from it
    after the first round is not continued: with too few sensors such fits would take most of the
    time of a run. After the deadline of F a hypothesis is returned unchanged, too.
    """
    if fit.law.chi2 > LOST_CHI2:
        return fit
    try:
        return _refine(fit)
    except OutOfTimeError:
        return fit


def _refine(fit: HypothesisFit) -> HypothesisFit:
    objective, total = fit.objective, len(fit.objective.recorded)
    from_growing_horizons = fit_all(
        [
            Fit(
                objective,
                partial(minimise_growing_horizon, phi=fit.phi, samples=round(share * total)),
            )
            for share in HORIZON_SHARES
        ]
    )
    noisier_problems = [
        replace(objective, noise=objective.noise.scaled(factor)) for factor in NOISE_FACTORS
    ]
    run = partial(minimise, phi=fit.phi, steps=REFINE_STEPS, tolerance=REFINE_TOLERANCE)
    *from_larger_noise, lowest = fit_all(
        [Fit(problem, run) for problem in (*noisier_problems, objective)]
    )
    for phi in (*from_growing_horizons, *(fitted.phi for fitted in from_larger_noise)):
        if not _leads_to(objective, phi, lowest):
            fitted = minimise(objective, phi, REFINE_STEPS, REFINE_TOLERANCE)
            lowest = min(lowest, fitted, key=lambda each: each.cost)
    if not lowest.converged and lowest.chi2 < POOR_CHI2 * objective.noise.count:
        lowest = minimise_in_rounds(objective, lowest.phi, REFINE_STEPS, REFINE_TOLERANCE, MIN_GAIN)
    return replace_minimum(fit, objective, lowest)


def _leads_to(objective: LeastSquaresProblem, phi: Tensor, lowest: FitResult) -> bool:
    """Return whether F falls along the straight line from some unknowns to a minimum.

    If there is no barrier in between, a fit from there would end in the same minimum.
    """
    share = torch.linspace(0, 1, PATH_POINTS, dtype=torch.float64)[:, None]
    costs, _ = objective.values(phi + share * (lowest.phi - phi))
    return bool((costs.diff() < REFINE_TOLERANCE * lowest.cost).all())


def replace_minimum(
    fit: HypothesisFit, objective: LeastSquaresProblem, fitted: FitResult
) -> HypothesisFit:
    """Return a hypothesis at another minimum; its score changes as F does."""
    law = fit.law
    [before], _ = fit.objective.values(fit.phi[None])
    score = law.score - float(before) + fitted.cost
    normal = objective.linearise(fitted.phi, fitted.readings)
    new_law = build_law(objective, fitted, score, normal)
    faults = faults_in_units(objective, fit.faults, normal) if fit.faults else law.faults
    new_law = replace(
        new_law,
        faults=faults,
        start_prior_factor=law.start_prior_factor,
        start_chance=law.start_chance,
        source=law.source,
    )
    return HypothesisFit(new_law, objective, fitted.phi, fit.faults)


def fit_growing_horizon(objective: LeastSquaresProblem, z: Tensor, bound: float) -> FitResult:
    """Fit from the given unknowns; if that leaves more than noise, also over a growing horizon.

    A fit under a narrow prior may end in a minimum from which the right one cannot be reached. F
    increases with the number of samples, so a fit above the bound is given up early, as is one that
    will not reach it.
    """
    fitted = _fit_start(objective, z, bound)
    if not _is_poor(objective, fitted):
        return fitted
    begin = torch.zeros_like(z)
    for grown in growing_horizon_fits(objective, begin, FIRST_SAMPLES):
        if grown.cost > bound:
            return fitted
        begin = grown.phi
    return min(fitted, _fit_start(objective, begin, bound), key=lambda each: each.cost)


def _fit_start(objective: LeastSquaresProblem, z: Tensor, bound: float) -> FitResult:
    """Fit with a rough tolerance, then until convergence if no more than noise is left."""
    fitted = minimise(objective, z, STEPS, ROUGH_TOLERANCE, bound=bound)
    if _is_poor(objective, fitted):
        return fitted
    return minimise(objective, fitted.phi, STEPS, TOLERANCE)


def _is_poor(objective: LeastSquaresProblem, fitted: FitResult) -> bool:
    """Tell whether a fit leaves more than noise."""
    return not fitted.chi2 < MAX_CHI2 * objective.noise.count
