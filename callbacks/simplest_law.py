"""The law of an assimilation with dynamics: the set of terms that the readings call for."""

from __future__ import annotations

import copy
import math

import numpy as np
import torch
from torch import Tensor

from dashred.core.budget import OutOfTimeError
from dashred.inference.fit.selection.subset_search import ProfiledProblem
from dashred.inference.latent_sindy.blocks import Array
from dashred.inference.segments.selection.candidate_sets import beam_search
from dashred.models.dynamics.dynamic_assimilation import DynamicAssimilation
from dashred.models.dynamics.state_fit import Fitted

# Sets that are tried at most. Each is the best one about the minimum with the last one.
ROUNDS = 4


def simplest_law(
    module: DynamicAssimilation, batch: tuple[Tensor, Tensor], proposed: Array
) -> tuple[Array, Fitted | None]:
    """Return the set of terms with the lowest score, and its minimum.

    The field was fitted with a law, so that its steps contain whatever the law contains, and a
    regression along it cannot refute a term. Here the states follow the law: about a minimum, they
    are eliminated from the linearised loss J, and what is left is a quadratic function of the
    coefficients of all terms. The set with the lowest

        n J / 2 + (terms) (ln n + 2 ln p)

    is fitted. This is the extended Bayesian information criterion for a choice among p terms (Chen
    & Chen, Biometrika 95, 2008). n J has the place of twice the deviance, because each reading
    counts twice in it: at its own time, and in the forecast of its time. The search is repeated
    about the minimum with the new set as long as the score falls. Losses can be compared at their
    minima only: where the steps do not fit the smallest q with any of these laws, the proposal is
    returned as it is, without a minimum. The assimilation is left as it was.

    Args:
        module: the assimilation, with its best state.
        batch: windows and fitted values of all samples.
        proposed: coefficients that a regression proposes, ``(term,)``.

    Returns:
        The coefficients at the minimum, ``(term,)``, and the minimum.
    """
    state = copy.deepcopy(module.state_dict())
    readings = int((~batch[1].isnan()).sum())
    penalty = math.log(readings) + 2 * math.log(len(proposed))

    def score(fitted: Fitted) -> float:
        terms = int(fitted.coefficients.count_nonzero())
        return readings * fitted.parts["train"] / 2 + terms * penalty

    best = module.refit(batch, torch.from_numpy(proposed))
    for _ in range(ROUNDS):
        try:
            coefficients = _best_law(module, batch, best, penalty)
        except OutOfTimeError:
            break
        if torch.equal(coefficients != 0, best.coefficients != 0):
            break
        found = module.refit(batch, coefficients, best.unknowns.states)
        if not score(found) < score(best):
            break
        best = found
    module.load_state_dict(state)
    if best.parts["step_error"] > 1.0:
        return proposed, None
    return best.coefficients.numpy(), best


def _best_law(
    module: DynamicAssimilation, batch: tuple[Tensor, Tensor], at: Fitted, penalty: float
) -> Tensor:
    """Return the coefficients of the set with the lowest score on the linearised problem."""
    fit, law = module.state_fit(batch[1]), at.unknowns.law.numpy()
    changes = fit.law_equations(at.unknowns, module.least_error)
    if changes is None:
        return at.coefficients
    profiled = ProfiledProblem.from_change(changes, law, np.full_like(law, fit.problem.precision))
    sets = {
        members: cost / 2 + len(members) * penalty
        for found in beam_search(profiled, [False] * len(law))
        for members, cost in found.items()
    }
    chosen = min(sets, key=sets.__getitem__)
    best = torch.zeros(len(law), dtype=torch.float64)
    if chosen:
        best[list(chosen)] = profiled.coefficients(chosen)
    return best * module.dynamics.scales
