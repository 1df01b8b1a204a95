"""The fit over the present horizon, which :mod:`.growing_horizon` extends."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from statistics import median

import torch
from torch import Tensor

from dashred.core.budget import NEVER
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import FitResult, minimise
from dashred.inference.fit.selection.subset_search import most_distinct_candidates
from dashred.inference.fit.selection.widened_fit import fit_widened

# A fit explains the first samples if it leaves at most this χ²/n. They are few, so that noise alone
# may leave more than 1.
EXPLAINED = 1.3
# A stage fails if its misfit exceeds the typical misfit of the earlier stages by this factor.
DIVERGED = 1.3
STAGE_STEPS = 6
# A stage ends at a step that lowers F by a smaller share.
TOLERANCE = 0.02
# Residuals are noise up to this χ²/n. A law of a widened prior that predicts the next stretch so
# well needs no fit there; if it leaves more, the prior is chosen again.
NOISE_LEVEL = 1.1


@dataclass
class HorizonState:
    """The fit over the present horizon, with some of the candidates.

    Attributes:
        objective: F over the whole record, with the present prior on ξ.
        phi: unknowns of the fit, with all candidates, ``(unknown,)``.
        samples: the present horizon.
        members: indices of the fitted candidates.
        readings: readings of the fit, ``(time, sensor)``.
        levels: ``(samples, χ²/n)`` of each stage.
        effort: number of Jacobians, each times its number of samples.
        narrow: prior stds before any of them was widened, ``(coefficient,)``.
    """

    objective: LeastSquaresProblem
    phi: Tensor
    samples: int
    members: tuple[int, ...]
    readings: Tensor = field(default_factory=lambda: torch.empty(0))
    levels: list[tuple[int, float]] = field(default_factory=list)
    effort: int = 0
    narrow: Tensor = field(init=False)

    def __post_init__(self) -> None:
        """Keep the prior stds before any of them is widened."""
        self.narrow = self.objective.prior_std

    @property
    def misfit_of_first_samples(self) -> float:
        """χ²/n that the fit of the first samples leaves; infinite after a blow-up."""
        misfit = self.levels[0][1]
        return math.inf if math.isnan(misfit) else misfit

    @property
    def explains_first_samples(self) -> bool:
        """Whether there are first samples, and their fit leaves no more than noise may."""
        is_read = self.objective.noise.truncate(self.levels[0][0]).count > 0
        return is_read and self.misfit_of_first_samples <= EXPLAINED

    @property
    def widened(self) -> tuple[int, ...]:
        """The candidates whose prior was widened."""
        return tuple(torch.nonzero(self.objective.prior_std > self.narrow).flatten().tolist())

    @property
    def widest(self) -> float:
        """The largest factor by which a prior was widened."""
        factors = self.objective.prior_std / self.narrow
        return float(factors.max()) if len(factors) else 1.0

    def fit_first(self) -> None:
        """Fit the first horizon, even after the deadline: the result needs a fit."""
        deadline, self.objective = self.objective.deadline, replace(self.objective, deadline=NEVER)
        fitted = self._fit(self.objective, self.members, self.samples, STAGE_STEPS)
        self._adopt(fitted, self.samples)
        if not self.explains_first_samples and self.members:
            self.widen(self.samples)
        self.objective = replace(self.objective, deadline=deadline)

    def advance(self, further: int, steps: int) -> bool:
        """Fit more samples; return whether the misfit stays near its typical level.

        A law that predicts them already is not fitted again, except to the whole record.
        """
        if self.widened and further < len(self.objective.recorded):
            predicted = self._fit(self.objective, self.members, further, 0)
            if self._level(predicted, further) <= NOISE_LEVEL:
                self._adopt(predicted, further)
                return True
        fitted = self._fit(self.objective, self.members, further, steps)
        # Written with "not", because the misfit is NaN after a blow-up.
        if not self._level(fitted, further) <= DIVERGED * self._typical_level:
            return False
        self._adopt(fitted, further)
        return True

    def reconsider(self) -> None:
        """Widen the prior again if it was widened for a law that leaves more than noise."""
        if self.widened and not self.levels[-1][1] <= NOISE_LEVEL:
            self.widen(self.samples)

    def choose_candidates(self, count: int) -> None:
        """Choose the candidates with the most distinct effects at the present horizon."""
        if not self.widened:
            self._replace(most_distinct_candidates(self.objective, self.phi, self.samples, count))

    def add_candidates(self, count: int) -> None:
        """Add the candidates with the most distinct effects at the present horizon."""
        others = most_distinct_candidates(self.objective, self.phi, self.samples, count)
        self._replace(tuple(sorted({*self.members, *others})))

    def _replace(self, members: tuple[int, ...]) -> None:
        """Use other candidates from now on, if they fit the present horizon as well."""
        fitted = self._fit(self.objective, members, self.samples, STAGE_STEPS)
        if members and self._level(fitted, self.samples) <= DIVERGED * self._typical_level:
            self.members = members
            self.levels.pop()
            self._adopt(fitted, self.samples)

    def widen(self, samples: int) -> bool:
        """Fit some samples with the prior that the evidence chooses for each candidate.

        Returns:
            whether the misfit stays near its typical level. At the present horizon, it has to be
            lower than before.
        """
        problem = self.objective.truncate(samples)
        found, jacobians = fit_widened(problem, self.narrow, self.phi, STAGE_STEPS, TOLERANCE)
        self.effort += jacobians * samples
        if found is None:
            return False
        is_present = samples == self.samples
        bound = self.levels[-1][1] if is_present else DIVERGED * self._typical_level
        if not self._level(found.fitted, samples) <= bound:
            return False
        if is_present:
            self.levels.pop()
        self.objective = replace(self.objective, prior_std=found.prior_std)
        self.members = tuple(range(len(found.prior_std)))
        self._adopt(found.fitted, samples)
        return True

    @property
    def _typical_level(self) -> float:
        return max(1.0, median(level for _, level in self.levels))

    def _fit(
        self, objective: LeastSquaresProblem, members: tuple[int, ...], samples: int, steps: int
    ) -> FitResult:
        problem = objective.subset(members).truncate(samples)
        begin = self.phi[objective.indices(members)]
        fitted = minimise(problem, begin, steps, TOLERANCE)
        self.effort += fitted.jacobians * samples
        return fitted

    def _level(self, fitted: FitResult, samples: int) -> float:
        return fitted.chi2 / max(1, self.objective.noise.truncate(samples).count)

    def _adopt(self, fitted: FitResult, samples: int) -> None:
        self.phi = self.objective.embed(fitted.phi, self.members)
        self.readings, self.samples = fitted.readings, samples
        self.levels.append((samples, self._level(fitted, samples)))
