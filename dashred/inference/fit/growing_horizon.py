"""Walk the fit from the first samples to the whole record: a growing horizon.

Over a long stretch the misfit of a wrong start has countless false minima; over a short one
it has none, and its solution is a good beginning for a slightly longer one
(docs/method.md#growing-horizon).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from statistics import median

import torch
from torch import Tensor

from dashred.core.progress import Report
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import FitResult, minimise
from dashred.inference.fit.subset_search import ProfiledProblem

GROWTH = 1.3
# A stage that fails is tried again with a shorter stretch.
SMALLEST_GROWTH = 1.03
# Misfit, relative to the level so far, at which a stage has lost the trajectory.
DIVERGED = 1.3
STAGE_STEPS = 6
# A step that gains less ends a stage: the next stage moves everything anyway.
TOLERANCE = 0.02
# The candidates are chosen again whenever the horizon has grown, and has to grow, by one factor;
# by their effects as far ahead as the other.
DOUBLED, AHEAD = 2, 3
# How often further candidates join a walk that has got lost.
REINFORCEMENTS = 2
# A walk that has cost as much as this many Jacobians over the whole record is given up.
EFFORT = 40


@dataclass(frozen=True)
class HorizonFit:
    """How far a walk came.

    Attributes:
        phi: the fit at the last horizon reached, ``(unknown,)``, among all candidates.
        members: the candidates that it carried.
        readings: of the fit, ``(time, sensor)``.
        samples: that horizon.
        is_complete: whether it is the whole record.
        levels: ``(samples, χ²/n)`` of each stage.
    """

    phi: Tensor
    members: tuple[int, ...]
    readings: Tensor
    samples: int
    is_complete: bool
    levels: list[tuple[int, float]]


def grow_horizon(
    objective: LeastSquaresProblem, phi: Tensor, samples: int, carried: int, report: Report
) -> HorizonFit:
    """Extend the horizon while the misfit stays near its level so far.

    The walk carries the candidates whose effects differ most over the next stretch; the others'
    place they can take. Where it gets lost, those that differ most there join in.

    Args:
        objective: F over the whole record, with a tight prior on ξ.
        phi: a fit of the first samples, ``(unknown,)``.
        samples: how many these are.
        carried: how many candidates the walk carries.
        report: progress.
    """
    total = len(objective.recorded)
    here = _State(objective, phi, samples, _telling(objective, phi, samples, carried))
    here.settle()
    chosen, reinforced, growth = samples, 0, GROWTH
    while here.samples < total and here.effort < EFFORT * total:
        if DOUBLED * chosen <= here.samples <= total / DOUBLED and growth == GROWTH:
            chosen = here.samples
            here.exchange(_telling(objective, here.phi, chosen, carried))
        further = min(total, max(here.samples + 1, round(here.samples * growth)))
        if here.advance(further, STAGE_STEPS if growth == GROWTH else 2 * STAGE_STEPS):
            growth = GROWTH
            report(further / total, f"horizon {further} of {total}, χ²/n {here.levels[-1][1]:.2f}")
            continue
        growth = 1 + (growth - 1) / 2
        if growth <= SMALLEST_GROWTH and reinforced < REINFORCEMENTS:
            others = _telling(objective, here.phi, here.samples, carried)
            here.exchange(tuple(sorted({*here.members, *others})))
            reinforced, growth = reinforced + 1, GROWTH
        elif growth <= SMALLEST_GROWTH:
            break
    reached = here.samples == total
    return HorizonFit(here.phi, here.members, here.readings, here.samples, reached, here.levels)


@dataclass
class _State:
    """Where a walk is: its fit of the samples so far, with some of the candidates."""

    objective: LeastSquaresProblem
    phi: Tensor
    samples: int
    members: tuple[int, ...]
    readings: Tensor = field(default_factory=lambda: torch.empty(0))
    levels: list[tuple[int, float]] = field(default_factory=list)
    effort: int = 0

    def settle(self) -> None:
        """Fit the samples that the walk begins with."""
        self._adopt(self._fit(self.members, self.samples, STAGE_STEPS), self.samples)

    def advance(self, further: int, steps: int) -> bool:
        """Fit more samples; tell whether the misfit stayed near its level."""
        tried = self._fit(self.members, further, steps)
        # A run that blows up has no level, and is not near any.
        if not self._level(tried, further) <= DIVERGED * self._usual:
            return False
        self._adopt(tried, further)
        return True

    def exchange(self, members: tuple[int, ...]) -> None:
        """Carry other candidates from here on, if they fit what is fitted."""
        tried = self._fit(members, self.samples, STAGE_STEPS)
        if members and self._level(tried, self.samples) <= DIVERGED * self._usual:
            self.members = members
            self.levels.pop()
            self._adopt(tried, self.samples)

    @property
    def _usual(self) -> float:
        return max(1.0, median(level for _, level in self.levels))

    def _fit(self, members: tuple[int, ...], samples: int, steps: int) -> FitResult:
        mine = self.objective.subset(members).truncate(samples)
        begin = self.phi[self.objective.indices(members)]
        fitted = minimise(mine, begin, steps, TOLERANCE)
        self.effort += fitted.jacobians * samples
        return fitted

    def _level(self, fitted: FitResult, samples: int) -> float:
        return fitted.chi2 / max(1, self.objective.noise.truncate(samples).count)

    def _adopt(self, fitted: FitResult, samples: int) -> None:
        self.phi = self.objective.embed(fitted.phi, self.members)
        self.readings, self.samples = fitted.readings, samples
        self.levels.append((samples, self._level(fitted, samples)))


def _telling(
    objective: LeastSquaresProblem, phi: Tensor, samples: int, count: int
) -> tuple[int, ...]:
    """Return the candidates whose effects differ most, a while beyond the samples fitted so far.

    None at all, where the fit blows up even within them.
    """
    every = tuple(range(len(objective.prior_std)))
    if count >= len(every):
        return every
    for reach in (AHEAD * samples, samples):
        window = objective.truncate(min(len(objective.recorded), reach))
        normal = window.linearise(phi)
        if normal.is_finite:
            return ProfiledProblem.from_normal_equations(normal, objective.modes).most_distinct(
                count
            )
    return ()
