"""Normal equations of a chain of states that share a few unknowns, and their solution."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class ChainEquations:
    """A symmetric, block-tridiagonal system with a border.

    For each state x_t of the chain, and the unknowns z that all have in common::

        C_{t-1} x_{t-1} + D_t x_t + C_tᵀ x_{t+1} + B_t z = −g_t
        Σ_t B_tᵀ x_t + E z = −h

    Attributes:
        diagonal: D_t, ``(time, mode, mode)``.
        coupling: C_t, between x_{t+1} (rows) and x_t (columns), ``(time - 1, mode, mode)``.
        border: B_t, ``(time, mode, common)``.
        corner: E, ``(common, common)``.
        gradient: g_t, ``(time, mode)``.
        common_gradient: h, ``(common,)``.
    """

    diagonal: Float[Tensor, "time mode mode"]
    coupling: Float[Tensor, "steps mode mode"]
    border: Float[Tensor, "time mode common"]
    corner: Float[Tensor, "common common"]
    gradient: Float[Tensor, "time mode"]
    common_gradient: Float[Tensor, " common"]

    def solve(self, damping: float) -> tuple[Tensor, Tensor]:
        """Return all x_t, ``(time, mode)``, and z, ``(common,)``.

        The block Cholesky factorisation costs a number of operations that is proportional to the
        length of the chain.

        Args:
            damping: is added to the diagonal, as Levenberg and Marquardt do.

        Raises:
            torch.linalg.LinAlgError: the matrix is not positive definite.
        """
        factors, below, reduced = self._forward(damping)
        common = self._common(reduced, damping)
        known = reduced[..., 0] + reduced[..., 1:] @ common
        found = [torch.empty(0)] * len(known)
        for t in range(len(known) - 1, -1, -1):
            rest = known[t] if t == len(below) else known[t] - below[t].T @ found[t + 1]
            found[t] = torch.linalg.solve_triangular(factors[t].T, rest[:, None], upper=True)[:, 0]
        return -torch.stack(found), common

    def eliminated(self) -> tuple[Tensor, Tensor]:
        """Return the matrix ``(common, common)`` and the gradient of z alone.

        The states follow z: they minimise the quadratic function for any z.
        """
        _, _, reduced = self._forward(damping=0.0)
        border = reduced[..., 1:].flatten(0, 1)
        gradient = self.common_gradient - border.T @ reduced[..., 0].flatten()
        return self.corner - border.T @ border, gradient

    def _forward(self, damping: float) -> tuple[list[Tensor], list[Tensor], Tensor]:
        """Return the factors, the blocks below them, and the solution of the right-hand sides."""
        damped = damping * torch.eye(self.diagonal.shape[1], dtype=self.diagonal.dtype)
        right = torch.cat([self.gradient[..., None], self.border], dim=2)
        factors: list[Tensor] = []
        below: list[Tensor] = []
        forward: list[Tensor] = []
        for t, (own, rows) in enumerate(zip(self.diagonal + damped, right, strict=True)):
            if t:
                own, rows = own - below[-1] @ below[-1].T, rows - below[-1] @ forward[-1]
            factor = torch.linalg.cholesky(own)
            factors.append(factor)
            forward.append(torch.linalg.solve_triangular(factor, rows, upper=False))
            if t < len(self.coupling):
                across = torch.linalg.solve_triangular(factor, self.coupling[t].T, upper=False)
                below.append(across.T)
        return factors, below, torch.stack(forward)

    def _common(self, reduced: Tensor, damping: float) -> Tensor:
        """Return z from its Schur complement."""
        border = reduced[..., 1:].flatten(0, 1)
        if not border.shape[1]:
            return self.common_gradient
        damped = self.corner + damping * torch.eye(len(self.corner), dtype=self.corner.dtype)
        own = damped - border.T @ border
        rest = self.common_gradient - border.T @ reduced[..., 0].flatten()
        factor = torch.linalg.cholesky(own)
        return -torch.cholesky_solve(rest[:, None], factor)[:, 0]
