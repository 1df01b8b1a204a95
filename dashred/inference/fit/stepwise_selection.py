"""Select the law: refit the promising sets through the simulator, and swap until none wins."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.core.progress import Report
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import chord_refits, minimise
from dashred.inference.fit.stepwise_moves import Set, neighbours, promising
from dashred.inference.fit.subset_search import ProfiledProblem

ROUNDS = 6
CHORD_STEPS = 6
# A row that gains less than this in F has come to its minimum, as far as ranking needs it.
SETTLED = 0.5
POLISH_STEPS = 6
# Rivals of the best set that get Jacobians of their own: about another law's trajectory a fit may
# get stuck far from where it belongs, if a field that no sensor reads has to move along.
RIVALS, RIVAL_STEPS, RIVAL_TOLERANCE = 4, 4, 1e-3
# Sets whose score lies farther than this from the best are given up.
HOPELESS = 40.0
# A set that is predicted to leave so many times the misfit of the best is not fitted to the end.
OUT_OF_QUESTION = 2.0
# A smaller change of σ, or of its correlation, changes no choice.
NOTICEABLE = 0.02


@dataclass(frozen=True)
class RefittedSet:
    """One set of candidates, refitted.

    Attributes:
        members: indices of its candidates, sorted.
        phi: the fit, ``(unknown,)``.
        cost: F.
        score: ``F + k (ln n + 2 ln p)``, lower is better.
    """

    members: Set
    phi: Tensor
    cost: float
    score: float


@dataclass(frozen=True)
class Selection:
    """What the search has found.

    Attributes:
        objective: F with the noise that the best law's residuals speak for.
        tried: every set that was refitted, the best first.
        exhausted: no swap, addition or omission wins any more.
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
        phi: a fit of all candidates, about which the first search is linearised.
        proposals: sets to refit beside those that the search finds.
        report: progress.
    """
    search = _Search(objective)
    search.linearise(phi)
    first = [(), *promising(search.problem), *proposals]
    search.refit(first)
    report(0.4, f"{len(search.tried)} sets refitted")
    exhausted = False
    for turn in range(ROUNDS):
        best = search.best
        if search.adopt_noise(best):
            search.rescore()
            best = search.best
        search.linearise(best.phi)
        costs = {members: found.cost for members, found in search.tried.items()}
        search.refit(neighbours(search.problem, best.members, costs))
        report(0.4 + 0.6 * (turn + 1) / ROUNDS, f"{len(search.tried)} sets refitted")
        if search.best.members == best.members and not search.settle_rivals():
            exhausted = True
            break
    ranked = sorted(search.tried.values(), key=lambda found: found.score)
    return Selection(search.objective, ranked, exhausted)


def polish(
    objective: LeastSquaresProblem, tried: RefittedSet, tolerance: float, steps: int = POLISH_STEPS
) -> RefittedSet:
    """Return the fit of one set with fresh Jacobians, until a step gains less than a share of F."""
    mine = objective.subset(tried.members)
    begin = tried.phi[objective.indices(tried.members)]
    fitted = minimise(mine, begin, steps, tolerance)
    score = fitted.cost + term_penalty(objective) * len(tried.members)
    return RefittedSet(
        tried.members, objective.embed(fitted.phi, tried.members), fitted.cost, score
    )


def term_penalty(objective: LeastSquaresProblem) -> float:
    """Return the cost of one candidate more: ``ln n + 2 ln p``.

    See docs/method.md#selection-of-the-law.
    """
    candidates = len(objective.prior_std)
    return math.log(objective.noise.effective_count) + 2 * math.log(candidates)


def choose_better(
    objective: LeastSquaresProblem, first: Tensor, second: Tensor
) -> tuple[Tensor, float]:
    """Return the better of two beginnings, ``(unknown,)``, and F there."""
    begins = torch.stack([first, second])
    costs, _ = objective.values(begins)
    chosen = int(costs.argmin())
    return begins[chosen], float(costs[chosen])


class _Search:
    """All sets tried so far, under one noise model and one linearisation."""

    def __init__(self, objective: LeastSquaresProblem) -> None:
        self.objective = objective
        self.tried: dict[Set, RefittedSet] = {}
        self.settled: set[Set] = set()

    @property
    def best(self) -> RefittedSet:
        """The set with the lowest score."""
        return min(self.tried.values(), key=lambda found: found.score)

    def linearise(self, phi: Tensor) -> None:
        """Move the linearisation to ``phi``."""
        # What blows up has no derivative, and its fits will not be chosen.
        self.normal = self.objective.linearise(phi)
        self.problem = ProfiledProblem.from_normal_equations(self.normal, self.objective.modes)

    def adopt_noise(self, best: RefittedSet) -> bool:
        """Estimate σ and its correlation from the residuals of the best set; tell if they moved."""
        objective = self.objective
        [readings] = objective.forward_model.readings(*objective.split(best.phi[None]))
        normal = self.normal if self.normal.is_finite else objective.linearise(best.phi)
        spent = normal.effective_parameters(objective.indices(best.members))
        noise = objective.estimate_noise(readings, spent)
        resized = float((noise.std / objective.noise.std - 1).abs().max())
        recorrelated = float((noise.correlation - objective.noise.correlation).abs().max())
        if max(resized, recorrelated) < NOTICEABLE:
            return False
        self.objective = replace(objective, noise=noise)
        return True

    def rescore(self) -> None:
        """Score the sets that may still win under the present noise; forget the others' scores."""
        bound = self.best.score + HOPELESS
        near = [found for found in self.tried.values() if found.score < bound]
        costs, _ = self.objective.values(torch.stack([found.phi for found in near]))
        for members, found in self.tried.items():
            self.tried[members] = replace(found, cost=math.inf, score=math.inf)
        for found, cost in zip(near, costs.tolist(), strict=True):
            score = cost + term_penalty(self.objective) * len(found.members)
            self.tried[found.members] = replace(found, cost=cost, score=score)

    def refit(self, sets: Sequence[Set]) -> None:
        """Refit sets, each from the linear prediction; an earlier, better fit stands."""
        sets = list(dict.fromkeys(tuple(sorted(members)) for members in sets))
        if not sets:
            return
        free = _free(self.objective, sets)
        begin = torch.stack([self._begin(members) for members in sets])
        found = chord_refits(
            self.objective, self.normal, begin, free, CHORD_STEPS, SETTLED, HOPELESS
        )
        for row, members in enumerate(sets):
            cost = float(found.cost[row])
            score = cost + term_penalty(self.objective) * len(members)
            if members not in self.tried or score < self.tried[members].score:
                self.tried[members] = RefittedSet(members, found.phi[row], cost, score)

    def settle_rivals(self) -> bool:
        """Fit the nearest sets that are no larger, parts of the best too, to the end.

        Returns:
            whether one wins.
        """
        best = self.best
        others = [
            found
            for members, found in self.tried.items()
            if 0 < len(members) <= len(best.members)
            and members != best.members
            and math.isfinite(found.score)
            and self._may_win(members)
        ]
        for rival in sorted(others, key=lambda found: found.score)[:RIVALS]:
            if rival.members in self.settled:
                continue
            self.settled.add(rival.members)
            begin = replace(rival, phi=self._at_start_of(best, rival))
            fitted = polish(self.objective, begin, RIVAL_TOLERANCE, RIVAL_STEPS)
            if fitted.score < rival.score:
                self.tried[rival.members] = fitted
        return self.best.members != best.members

    def _may_win(self, members: Set) -> bool:
        """Tell whether a set might leave as little as the best does, were the model linear."""
        [expected] = self.problem.costs([members]).tolist()
        return expected < OUT_OF_QUESTION * max(self.best.cost, self.objective.noise.count)

    def _at_start_of(self, best: RefittedSet, rival: RefittedSet) -> Tensor:
        """Return the better beginning: where the rival is, or its law at the best one's start."""
        moved = rival.phi.clone()
        moved[: self.objective.modes] = best.phi[: self.objective.modes]
        return choose_better(self.objective, rival.phi, moved)[0]

    def _begin(self, members: Set) -> Tensor:
        """Return the best unknowns of the linearised problem."""
        solution = self.normal.solution(self.objective.indices(members))
        return self.objective.embed(solution, members)


def _free(objective: LeastSquaresProblem, sets: Sequence[Set]) -> Tensor:
    free = torch.zeros((len(sets), objective.modes + len(objective.prior_std)), dtype=torch.bool)
    for row, members in enumerate(sets):
        free[row, objective.indices(members)] = True
    return free
