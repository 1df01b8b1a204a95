"""How probable a start is under its prior, by its size alone.

The evidence of a wider prior looks at every mode. A start whose size is that of its prior, but
which has another correlation length than was assumed, has improbable modes as well.
"""

from __future__ import annotations

import torch
from scipy.stats import chi2
from torch import Tensor

from dashred.inference.initial_state.start_models import StartModel


def chance_of_start(model: StartModel, z: Tensor, points: int) -> float:
    """Return the probability that a start of the prior is as far from its mean in any field.

    The mean square of the deviation of a field is ``zᵀ G z``, with ``G_kl`` the mean of the product
    of the modes k and l over the grid. Its distribution is approximated by that of
    ``(tr G/ν) χ²_ν`` with ``ν = (tr G)²/tr G²`` (Box, Ann. Math. Statist. 25, 1954). The smallest
    probability of the fields and episodes is corrected for their number (Šidák).

    Args:
        model: the prior u₀(z).
        z: of the start, ``(mode,)``.
        points: number of points of the grid.
    """
    eye = torch.eye(model.size, dtype=torch.float64)
    mean = model.start(torch.zeros_like(eye[:1]))
    modes = (model.start(eye) - mean).reshape(model.size, -1, points)
    deviation = (model.start(z[None]) - mean).reshape(-1, points)
    chances = []
    for own, deviates in zip(modes.unbind(1), deviation, strict=True):
        gram = own @ own.T / points
        size = float(gram.trace())
        if size > 0:
            freedom = size**2 / float(gram.square().sum())
            ratio = float(deviates.square().mean()) / size
            chances.append(float(chi2.sf(freedom * ratio, freedom)))
    return 1 - (1 - min(chances)) ** len(chances) if chances else 1.0
