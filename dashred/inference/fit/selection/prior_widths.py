"""Prior widths of the coefficients by the evidence of a linearised fit.

The natural scale of a coefficient assumes that the missing term is smaller than the tendency of the
simulator. Of a simulator that lacks its strongest term this is wrong, and a prior of that width
forbids the true law. Each candidate therefore has its own width d_j, and the widths minimise

    -2 ln p(y) = c - gᵀ(G + D⁻²)⁻¹ g + ln det(I + D G D) + 2 ln p · (number of widened candidates)

in which the start and ξ are integrated out (automatic relevance determination). The determinant
makes a needless width expensive, so few candidates are widened. One width is changed at a time; the
effect of each change has a closed form (Tipping & Faul, *Fast marginal likelihood maximisation for
sparse Bayesian models*, 2003).
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from dashred.inference.fit.selection.subset_search import ProfiledProblem

# Widths that a candidate may have, in units of its first one.
FACTORS = (1.0, 4.0, 16.0, 64.0)
# A change of one width has to lower -2 ln p(y) by more than this.
LEAST_GAIN = 1.0
SMALLEST = 1e-12


def widen_by_evidence(problem: ProfiledProblem, first: Tensor, limits: Tensor) -> Tensor:
    """Return the width of every candidate, ``(candidate,)``.

    Args:
        problem: the profiled problem at a fit; its own prior is not used.
        first: the narrowest widths, ``(candidate,)``.
        limits: the largest widths, ``(candidate,)``; a larger first one stays.
    """
    count = len(first)
    widths = torch.minimum(
        first[:, None] * torch.tensor(FACTORS, dtype=torch.float64),
        torch.maximum(limits, first)[:, None],
    )
    penalty = width_penalty(count) * (widths > first[:, None])
    chosen, everything = torch.zeros(count, dtype=torch.long), torch.arange(count)
    for _ in range(len(FACTORS) * count):
        costs = _evidence_by_width(problem, widths[everything, chosen], widths) + penalty
        gains = costs[everything, chosen][:, None] - costs
        best = int(gains.argmax())
        candidate, width = divmod(best, len(FACTORS))
        # Written with "not", because a gain is NaN if the columns are not finite.
        if not float(gains[candidate, width]) > LEAST_GAIN:
            break
        chosen[candidate] = width
    return widths[everything, chosen]


def width_penalty(count: int) -> float:
    """Return the penalty for each widened one of some candidates: ``2 ln p``."""
    return 2 * math.log(max(2, count))


def _evidence_by_width(problem: ProfiledProblem, present: Tensor, widths: Tensor) -> Tensor:
    """Return -2 ln p(y) for each width of each candidate, less a constant of the candidate.

    Args:
        problem: the profiled problem.
        present: present widths, ``(candidate,)``.
        widths: widths to try, ``(candidate, width)``.
    """
    gram, target = problem.gram, problem.target
    scaled = present[:, None] * gram * present
    eye = torch.eye(len(present), dtype=gram.dtype)
    inverse, is_singular = torch.linalg.inv_ex(eye + scaled)
    if is_singular:  # Columns of a run that nearly diverges are beyond the range of floats.
        return torch.full_like(widths, math.nan)
    covariance = inverse * present[:, None] * present
    size = gram.diagonal() - ((gram @ covariance) * gram).sum(dim=1)
    match = target - gram @ (covariance @ target)
    # Without the candidate itself among the fitted ones.
    alone = (1 - size * present**2).clamp(min=SMALLEST)
    size, match = (size / alone).clamp(min=0)[:, None], (match / alone)[:, None]
    grown = 1 + widths**2 * size
    return grown.log() - match**2 * widths**2 / grown
