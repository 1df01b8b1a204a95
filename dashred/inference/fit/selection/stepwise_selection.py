"""Stepwise selection of the law: refit sets of candidates through the simulator."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.core.budget import OutOfTimeError
from dashred.core.progress import Report
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import chord_refits, minimise
from dashred.inference.fit.selection.stepwise_moves import (
    Set,
    exchanges,
    neighbouring_sets,
    promising_sets,
)
from dashred.inference.fit.selection.subset_search import ProfiledProblem

ROUNDS = 6
CHORD_STEPS = 6
# A chord fit ends if a step lowers F by less than this: the ranking needs no more.
CHORD_TOLERANCE = 0.5
POLISH_STEPS = 6
# Number of rivals of the best set that are refitted with their own Jacobians, and how. With the
# Jacobian of another law a fit may get stuck, if a field that no sensor reads has to change too.
RIVALS, RIVAL_STEPS, RIVAL_TOLERANCE = 4, 4, 1e-3
# A set whose score exceeds the best by more than this is given up.
SCORE_MARGIN = 40.0
# A rival is refitted if its predicted F is below this multiple of the best F, or of the number of
# samples if that is larger.
LARGEST_COST_RATIO = 2.0
# A smaller change of σ (relative) or of the correlation is ignored.
NOISE_TOLERANCE = 0.02


@dataclass(frozen=True)
class RefittedSet:
    """The fit of one set of candidates.

    Attributes:
        members: indices of the candidates, sorted.
        phi: unknowns of the fit, ``(unknown,)``; zero for other candidates.
        cost: F.
        score: ``F + k (ln n + 2 ln p)``, lower is better.
    """

    members: Set
    phi: Tensor
    cost: float
    score: float


@dataclass(frozen=True)
class Selection:
    """The result of the search.

    Attributes:
        objective: F with the noise model estimated from the residuals of the best set.
        tried: every refitted set, the best first.
        exhausted: whether no swap, addition or omission gives a better score.
    """

    objective: LeastSquaresProblem
    tried: list[RefittedSet]
    exhausted: bool


def select(
    objective: LeastSquaresProblem, phi: Tensor, proposals: Iterable[Set], report: Report
) -> Selection:
    """Find the set of candidates with the best score.

    Args:
        objective: F over the whole record with a weak prior on ξ.
        phi: a fit of all candidates, where the problem is linearised first.
        proposals: further sets to refit.
        report: progress.
    """
    search = _Search(objective, phi)
    first = [(), *promising_sets(search.problem), *proposals]
    search.refit(first)
    report(0.4, f"{len(search.tried)} sets refitted")
    exhausted = False
    for turn in range(ROUNDS):
        if objective.deadline.is_over:
            break
        best = search.best
        if search.update_noise(best):
            search.rescore()
            best = search.best
        search.linearise(best.phi)
        costs = {members: found.cost for members, found in search.tried.items()}
        search.refit(neighbouring_sets(search.problem, search.first, best.members, costs))
        search.refit_smaller()
        report(0.4 + 0.6 * (turn + 1) / ROUNDS, f"{len(search.tried)} sets refitted")
        if search.best.members == best.members and not search.refit_rivals():
            exhausted = True
            break
    ranked = sorted(search.tried.values(), key=lambda found: found.score)
    return Selection(search.objective, ranked, exhausted)


def polish(
    objective: LeastSquaresProblem, tried: RefittedSet, tolerance: float, steps: int = POLISH_STEPS
) -> RefittedSet:
    """Return the fit of one set with fresh Jacobians, until a step lowers F by a smaller share.

    After the deadline of F, the fit is returned as it is.
    """
    problem = objective.subset(tried.members)
    begin = tried.phi[objective.indices(tried.members)]
    try:
        fitted = minimise(problem, begin, steps, tolerance)
    except OutOfTimeError:
        return tried
    score = fitted.cost + term_penalty(objective) * len(tried.members)
    return RefittedSet(
        tried.members, objective.embed(fitted.phi, tried.members), fitted.cost, score
    )


def term_penalty(objective: LeastSquaresProblem) -> float:
    """Return the penalty for each candidate: ``ln n + 2 ln p``.

    See docs/method.md#selection-of-the-law.
    """
    candidates = len(objective.prior_std)
    return math.log(objective.noise.effective_count) + 2 * math.log(candidates)


def choose_better(
    objective: LeastSquaresProblem, first: Tensor, second: Tensor
) -> tuple[Tensor, float]:
    """Return the one of two points with the lower F, ``(unknown,)``, and its F."""
    begins = torch.stack([first, second])
    costs, _ = objective.values(begins)
    chosen = int(costs.argmin())
    return begins[chosen], float(costs[chosen])


class _Search:
    """The sets refitted so far, under one noise model and one linearisation."""

    def __init__(self, objective: LeastSquaresProblem, phi: Tensor) -> None:
        self.objective = objective
        self.tried: dict[Set, RefittedSet] = {}
        self.refitted_rivals: set[Set] = set()
        self.linearise(phi)
        self.first = self.problem

    @property
    def best(self) -> RefittedSet:
        """The set with the lowest score."""
        return min(self.tried.values(), key=lambda found: found.score)

    def linearise(self, phi: Tensor) -> None:
        """Linearise the problem at ``phi``."""
        self.normal = self.objective.linearise(phi)
        self.problem = ProfiledProblem.from_normal_equations(self.normal, self.objective.modes)

    def update_noise(self, best: RefittedSet) -> bool:
        """Estimate the noise from the residuals of the best set; return whether it changed."""
        objective = self.objective
        [readings] = objective.forward_model.readings(*objective.split(best.phi[None]))
        normal = self.normal if self.normal.is_finite else objective.linearise(best.phi)
        parameters = normal.effective_parameters(objective.indices(best.members))
        noise = objective.estimate_noise(readings, parameters)
        resized = float((noise.std / objective.noise.std - 1).abs().max())
        recorrelated = float((noise.correlation - objective.noise.correlation).abs().max())
        if max(resized, recorrelated) < NOISE_TOLERANCE:
            return False
        self.objective = replace(objective, noise=noise)
        return True

    def rescore(self) -> None:
        """Compute the scores of the near sets under the new noise model; the others get inf."""
        bound = self.best.score + SCORE_MARGIN
        # Written with "<=": all scores are infinite if the simulator blows up with every set.
        near = [found for found in self.tried.values() if found.score <= bound]
        costs, _ = self.objective.values(torch.stack([found.phi for found in near]))
        for members, found in self.tried.items():
            self.tried[members] = replace(found, cost=math.inf, score=math.inf)
        for found, cost in zip(near, costs.tolist(), strict=True):
            score = cost + term_penalty(self.objective) * len(found.members)
            self.tried[found.members] = replace(found, cost=cost, score=score)

    def refit(self, sets: Sequence[Set]) -> None:
        """Refit sets, each from the linear prediction; keep an earlier fit with a better score."""
        sets = list(dict.fromkeys(tuple(sorted(members)) for members in sets))
        if not sets:
            return
        free = _free(self.objective, sets)
        begin = torch.stack([self._predicted(members) for members in sets])
        found = chord_refits(
            self.objective, self.normal, begin, free, CHORD_STEPS, CHORD_TOLERANCE, SCORE_MARGIN
        )
        for row, members in enumerate(sets):
            cost = float(found.cost[row])
            score = cost + term_penalty(self.objective) * len(members)
            if members not in self.tried or score < self.tried[members].score:
                self.tried[members] = RefittedSet(members, found.phi[row], cost, score)

    def refit_smaller(self) -> None:
        """Refit the best near set of each smaller size with its own Jacobians.

        A set of many wrong terms can be better than a true law whose fit is stuck.
        """
        best = self.best
        by_size: dict[int, RefittedSet] = {}
        for rival in self._rivals(best):
            by_size.setdefault(len(rival.members), rival)
        smaller = [rival for size, rival in by_size.items() if size < len(best.members)]
        self._refit_with_own_jacobians(smaller, best)

    def refit_rivals(self) -> bool:
        """Refit the best rivals that are no larger than the best set, with their own Jacobians.

        Those that had nearly the same effect at first are among them.

        Returns:
            whether a rival is now the best set.
        """
        best = self.best
        rivals = self._rivals(best)
        alike = set(exchanges(self.first, best.members))
        others = [rival for rival in rivals[RIVALS:] if rival.members in alike]
        self._refit_with_own_jacobians([*rivals[:RIVALS], *others], best)
        return self.best.members != best.members

    def _rivals(self, best: RefittedSet) -> list[RefittedSet]:
        """Return the near sets that are no larger than the best set, by their scores."""
        rivals = [
            found
            for members, found in self.tried.items()
            if 0 < len(members) <= len(best.members)
            and members != best.members
            and math.isfinite(found.score)
            and self._is_near(members)
        ]
        return sorted(rivals, key=lambda found: found.score)

    def _refit_with_own_jacobians(self, rivals: Sequence[RefittedSet], best: RefittedSet) -> None:
        """Refit sets that have not been refitted like this before; keep a better earlier fit."""
        for rival in rivals:
            if rival.members in self.refitted_rivals:
                continue
            self.refitted_rivals.add(rival.members)
            begin = replace(rival, phi=self._choose_start(best, rival))
            fitted = polish(self.objective, begin, RIVAL_TOLERANCE, RIVAL_STEPS)
            if fitted.score < rival.score:
                self.tried[rival.members] = fitted

    def _is_near(self, members: Set) -> bool:
        """Return whether the predicted F of a set is near the F of the best."""
        [expected] = self.problem.costs([members]).tolist()
        return expected < LARGEST_COST_RATIO * max(self.best.cost, self.objective.noise.count)

    def _choose_start(self, best: RefittedSet, rival: RefittedSet) -> Tensor:
        """Return the rival's unknowns, or its law with the start of the best, by the lower F."""
        moved = rival.phi.clone()
        moved[: self.objective.modes] = best.phi[: self.objective.modes]
        return choose_better(self.objective, rival.phi, moved)[0]

    def _predicted(self, members: Set) -> Tensor:
        """Return the minimiser of the linearised problem."""
        solution = self.normal.solution(self.objective.indices(members))
        return self.objective.embed(solution, members)


def _free(objective: LeastSquaresProblem, sets: Sequence[Set]) -> Tensor:
    free = torch.zeros((len(sets), objective.modes + len(objective.prior_std)), dtype=torch.bool)
    for row, members in enumerate(sets):
        free[row, objective.indices(members)] = True
    return free
