"""Normal equations, solved though rounding may have made them singular."""

from __future__ import annotations

import torch
from torch import Tensor

# A diagonal of ones can be told from less than this no more, after a Jacobian's rounding.
ROUNDING = 1e-12


def solve(matrix: Tensor, right: Tensor) -> Tensor:
    """Return ``A⁻¹ b`` of symmetric ``A = JᵀJ + P``.

    Columns that are alike to rounding (powers of a field that hardly varies about its mean) drown
    the prior: then with a ridge of rounding's own size on the diagonal, scaled to ones.

    Args:
        matrix: A, ``(*batch, unknown, unknown)``.
        right: b, ``(*batch, unknown, column)``.
    """
    found, failed = torch.linalg.solve_ex(matrix, right)
    if not failed.any():
        return found
    size = matrix.diagonal(dim1=-2, dim2=-1).sqrt()[..., None]
    room = ROUNDING * torch.eye(matrix.shape[-1], dtype=matrix.dtype, device=matrix.device)
    again, _ = torch.linalg.solve_ex(matrix / size / size.mT + room, right / size)
    return torch.where(failed[..., None, None].bool(), again / size, found)
