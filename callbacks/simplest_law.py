"""Elimination of terms from the law of an assimilation with dynamics."""

from __future__ import annotations

import copy
import math

import torch
from torch import Tensor

from dashred.inference.latent_sindy.best_subsets import best_subsets
from dashred.inference.latent_sindy.blocks import Array, Blocks
from dashred.models.dynamics.dynamic_assimilation import DynamicAssimilation, Fitted


def simplest_law(
    module: DynamicAssimilation, batch: tuple[Tensor, Tensor], blocks: Blocks, proposed: Array
) -> tuple[Array, Fitted | None]:
    """Return the smallest part of a law that explains the readings as well as all of it.

    The field was fitted with the law, so that its steps contain whatever the law contains, and a
    regression along it cannot refute a term. Here the field is fitted again with each part of the
    law, the smallest first, and the first one is taken for which

        n (J − J_all) ≤ (terms left out) ln n,

    the Bayesian information criterion, with the loss J in place of the deviance of a reading. The
    part of a given size is the one with the lowest error in the regression. Losses can be compared
    at their minima only: where the steps do not fit the smallest q even with the whole law, the
    proposal is returned as it is, without a minimum. The assimilation is left as it was.

    Args:
        module: the assimilation, with its best state.
        batch: windows and fitted values of all samples.
        blocks: the regression along its field.
        proposed: coefficients that the regression proposes, ``(term,)``.

    Returns:
        The coefficients at the minimum with this part, ``(term,)``, and the minimum.
    """
    support = [int(j) for j in proposed.nonzero()[0]]
    state = copy.deepcopy(module.state_dict())
    *parts, everything = best_subsets(blocks, support) if support else [proposed]
    whole = module.refit(batch, torch.from_numpy(everything))
    if whole.parts["step_error"] > 1.0:
        module.load_state_dict(state)
        return proposed, None
    found = whole
    readings = int((~batch[1].isnan()).sum())
    for size, part in enumerate(parts):
        other = module.refit(batch, torch.from_numpy(part), whole.unknowns)
        excess = readings * (other.parts["train"] - whole.parts["train"])
        if excess <= (len(support) - size) * math.log(readings):
            found = other
            break
    module.load_state_dict(state)
    return found.coefficients.numpy(), found
