"""Solution of normal equations that may be singular by rounding."""

from __future__ import annotations

import torch
from torch import Tensor

# Rounding error of a Jacobian, relative to a diagonal of ones.
ROUNDING = 1e-12


def solve(matrix: Tensor, right: Tensor) -> Tensor:
    """Return ``A⁻¹ b`` for a symmetric ``A = JᵀJ + P``.

    Nearly collinear columns (powers of a field that hardly varies about its mean) make A singular
    by rounding. A is then scaled to a unit diagonal, and a ridge of the size of the rounding error
    is added to the diagonal.

    Args:
        matrix: A, ``(*batch, unknown, unknown)``.
        right: b, ``(*batch, unknown, column)``.
    """
    solution, failed = torch.linalg.solve_ex(matrix, right)
    if not failed.any():
        return solution
    size = matrix.diagonal(dim1=-2, dim2=-1).sqrt()[..., None]
    ridge = ROUNDING * torch.eye(matrix.shape[-1], dtype=matrix.dtype, device=matrix.device)
    regularised, _ = torch.linalg.solve_ex(matrix / size / size.mT + ridge, right / size)
    return torch.where(failed[..., None, None].bool(), regularised / size, solution)
