"""The law of an assimilation with dynamics: the set of terms that the readings call for."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from dashred.core.budget import OutOfTimeError
from dashred.inference.fit.selection.subset_search import ProfiledProblem
from dashred.inference.segments.selection.candidate_sets import beam_search
from dashred.models.dynamics.state_fit import Minimum

# Sets that are tried at most. Each is the best one about the minimum with the last one.
ROUNDS = 4


def simplest_law(start: Minimum) -> Minimum:
    """Return the minimum with the set of terms that has the lowest score.

    The field was fitted with a law, so that its steps contain whatever the law contains, and a
    regression along it cannot refute a term. Here the states follow the law (:func:`best_law`). The
    set with the lowest score is fitted, and the search is repeated about its minimum as long as the
    score falls.

    Args:
        start: where the search begins.
    """
    count, penalty = start.loss.problem.count, _penalty(start)

    def score(minimum: Minimum) -> float:
        terms = int(minimum.fitted.coefficients.count_nonzero())
        return count * minimum.fitted.parts["train"] / 2 + terms * penalty

    best = start
    for _ in range(ROUNDS):
        try:
            law = best_law(best)
        except OutOfTimeError:
            break
        if torch.equal(law != 0, best.fitted.coefficients != 0):
            break
        found = best.with_law(law)
        if not score(found) < score(best):
            break
        best = found
    return best


def best_law(at: Minimum) -> Tensor:
    """Return the coefficients of the set of terms with the lowest score, linearised at a minimum.

    The states are eliminated from the linearised loss J of all terms: they follow the law. What is
    left is a quadratic function of the coefficients, and the score of a set is ::

        n J / 2 + (terms) (ln n + 2 ln p)

    This is the extended Bayesian information criterion for a choice among p terms (Chen & Chen,
    Biometrika 95, 2008). n J has the place of twice the deviance, because each reading counts twice
    in it: at its own time, and in the forecast of its time. Without a Cholesky factor of the normal
    equations, the law of the minimum is returned.

    Raises:
        OutOfTimeError: the time is up.
    """
    unknowns, problem = at.fitted.unknowns, at.loss.problem
    changes = at.loss.law_equations(unknowns, at.error)
    if changes is None:
        return at.fitted.coefficients
    law, penalty = unknowns.law.numpy(), _penalty(at)
    profiled = ProfiledProblem.from_change(changes, law, np.full_like(law, problem.precision))
    sets = {
        members: cost / 2 + len(members) * penalty
        for found in beam_search(profiled, [False] * len(law))
        for members, cost in found.items()
    }
    chosen = min(sets, key=sets.__getitem__)
    best = torch.zeros(len(law), dtype=torch.float64)
    if chosen:
        best[list(chosen)] = profiled.coefficients(chosen)
    return best * problem.dynamics.scales


def _penalty(at: Minimum) -> float:
    """Return the price of one term more."""
    return math.log(at.loss.problem.count) + 2 * math.log(len(at.fitted.coefficients))
