"""Levels of a free forcing, which the evidence of a linearised model chooses."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import torch
from torch import Tensor

from dashred.inference.fit.least_squares import NormalEquations
from dashred.inference.forward.forcing_block import ForcingBlock

# Choices of the prior std of an amplitude, as shares of the equation's tendency; 0: no forcing.
LEVELS = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0)
# Choices where the largest of these loses the recording: a source at one place may be far stronger
# than what the simulator does on average.
STRONG_LEVELS = (3.0, 10.0, 30.0)
# Used in place of 0 to keep the prior regular.
ZERO_LEVEL = 1e-6
# Possible rounding error of a smallest eigenvalue, as a share of the largest matrix entry.
ROUNDING = 1e-12


def evidence(normal: NormalEquations, index: Sequence[int]) -> float:
    """Return ``-2 ln p(y)`` of a linearised model with some of its unknowns, up to a constant.

    ``min F + ln det(JᵀJ + P) - ln det P`` (Laplace's approximation).
    """
    chosen = list(index)
    hessian = normal.hessian[chosen][:, chosen]
    precision = normal.precision[chosen]
    right_side = normal.right_side[chosen]
    size = precision.sqrt()
    scaled = hessian / size[:, None] / size
    factor, failed = torch.linalg.cholesky_ex(scaled)
    if failed:
        # If a trajectory is about to blow up, rounding errors of its columns exceed the prior.
        jitter = ROUNDING * scaled.diagonal().max() * torch.eye(len(scaled), dtype=scaled.dtype)
        factor = torch.linalg.cholesky(scaled + jitter)
    whitened = torch.linalg.solve_triangular(factor, (right_side / size)[:, None], upper=False)
    least = float(normal.target.square().sum() - whitened.square().sum())
    return least + 2 * float(factor.diagonal().log().sum())


def best_levels(
    normal: NormalEquations,
    block: ForcingBlock,
    equations: Sequence[int],
    choices: Sequence[float],
) -> tuple[float, ...]:
    """Return the level of each equation with the best evidence."""
    combinations = level_combinations(equations, len(block.size), choices)
    return min(combinations, key=lambda levels: evidence_of_levels(normal, block, levels))


def level_combinations(
    equations: Sequence[int], fields: int, choices: Sequence[float] = LEVELS
) -> list[tuple[float, ...]]:
    """Return all combinations of levels of the equations."""
    return list(product(*(choices if e in equations else choices[:1] for e in range(fields))))


def evidence_of_levels(
    normal: NormalEquations, block: ForcingBlock, levels: tuple[float, ...]
) -> float:
    """Return the evidence of a forcing with these levels."""
    precision = torch.cat([normal.precision[: -block.count], prior_stds(block, levels) ** -2])
    return evidence(normal.with_precision(precision), range(len(precision)))


def prior_stds(block: ForcingBlock, levels: Sequence[float]) -> Tensor:
    """Return the prior std of each amplitude at these levels, ``(amplitude,)``."""
    shares = torch.tensor([max(level, ZERO_LEVEL) for level in levels], dtype=torch.float64)
    return block.by_amplitude(shares * block.size)
