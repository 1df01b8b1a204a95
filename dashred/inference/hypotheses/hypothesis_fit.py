"""An explanation with the fit that gave it, to be fitted again: under other noise, or anew."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

from torch import Tensor

from dashred.inference.fit.law import Law, build_law
from dashred.inference.fit.least_squares import LeastSquaresProblem, NormalEquations
from dashred.inference.fit.levenberg_marquardt import (
    FitResult,
    minimise,
    minimise_growing_horizon,
    minimise_in_rounds,
)

STEPS, TOLERANCE = 10, 1e-4
# A score this much worse than the best is out of the question.
HOPELESS = 60.0
# What is settled is fitted on until a step, or a round of them, gains next to nothing: also from so
# much of the record, and from under so many times the noise.
SETTLING_STEPS, SETTLED, WORTH, SHARES, LOOSER = 20, 1e-5, 1.0, (0.17, 0.25, 0.5), (2.0, 4.0)
# What leaves so many times the noise's squares has lost the recording: no minimum nearby is right.
LOST = 30.0
# And what still leaves so many after the first round.
FAR = 3.0


@dataclass(frozen=True)
class LeftOut:
    """A sensor that had no part in a fit, because it may be at fault.

    Attributes:
        bare: the explanation without what is wrong with the sensor.
        sensor: its index.
        gain: by how much F is lower with the fault than without, penalty and all, were the model
            linear: a fit to all samples may get stuck, and its F is no match for a linear one.
    """

    bare: HypothesisFit
    sensor: int
    gain: float


@dataclass(frozen=True)
class HypothesisFit:
    """An explanation, and where it was fitted.

    Attributes:
        law: the explanation.
        objective: F, in its own unknowns.
        phi: its minimum.
        left_out: the sensor that the fit was made without; None where it was made with all.
    """

    law: Law
    objective: LeastSquaresProblem
    phi: Tensor
    left_out: LeftOut | None = None

    @cached_property
    def normal(self) -> NormalEquations:
        """F linearised about its minimum: several questions are put to it, and it is dear."""
        return self.objective.linearise(self.phi)


def by_score(cause: HypothesisFit) -> float:
    """Return what explanations are ranked by: the lowest is the best."""
    return cause.law.score


def refitted(cause: HypothesisFit, objective: LeastSquaresProblem) -> HypothesisFit:
    """Return an explanation under another noise, or of other samples; its score moves with F.

    Args:
        cause: the explanation.
        objective: F in the same unknowns.
    """
    return ended(cause, objective, minimise(objective, cause.phi, STEPS, TOLERANCE))


def settled(cause: HypothesisFit) -> HypothesisFit:
    """Return an explanation fitted until nothing is gained, from several beginnings.

    Over a long record of chaos the lowest minimum has many others around it. Some are none under
    larger noise, others over a shorter stretch. A round of steps from each tells which is the
    lowest, and that one alone is fitted on. What has lost the recording stays as it is, and what is
    far from it after a round ends there: so many fits of such laws took most of a run that had too
    few sensors to find one.
    """
    if cause.law.chi2 > LOST:
        return cause
    objective, total = cause.objective, len(cause.objective.recorded)
    grown = [
        minimise_growing_horizon(objective, cause.phi, round(share * total)) for share in SHARES
    ]
    loose = [replace(objective, noise=objective.noise.scaled(factor)) for factor in LOOSER]
    freed = [minimise(wide, cause.phi, SETTLING_STEPS, SETTLED).phi for wide in loose]
    begun = (cause.phi, *grown, *freed)
    fits = [minimise(objective, phi, SETTLING_STEPS, SETTLED) for phi in begun]
    lowest = min(fits, key=lambda fitted: fitted.cost)
    if not lowest.converged and lowest.chi2 < FAR * objective.noise.count:
        lowest = minimise_in_rounds(objective, lowest.phi, SETTLING_STEPS, SETTLED, WORTH)
    return ended(cause, objective, lowest)


def ended(cause: HypothesisFit, objective: LeastSquaresProblem, fitted: FitResult) -> HypothesisFit:
    """Return an explanation where another fit of it has ended; its score moves with F."""
    law = cause.law
    [before], _ = cause.objective.values(cause.phi[None])
    score = law.score - float(before) + fitted.cost
    found = build_law(objective, fitted, score)
    again = replace(found, fault=law.fault, start_prior_factor=law.start_prior_factor)
    return HypothesisFit(again, objective, fitted.phi)
