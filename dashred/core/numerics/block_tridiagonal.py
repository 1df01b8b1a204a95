"""Normal equations of a chain of nodes with unknowns that all of them share.

The unknowns are the nodes' deviations and a border ξ. The matrix is block tridiagonal in the
nodes::

    ( A   B ) (δx)   (a)
    ( Bᵀ  C ) (δξ) = (b)

A is banded and positive definite: its Cholesky factor costs O(nodes · field³).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve, cho_solve_banded, cholesky_banded

Array = NDArray[np.float64]

# A diagonal element below this is that of an unknown without any effect.
TINY = 1e-300


@dataclass(frozen=True)
class BlockNormal:
    """Normal equations about one point.

    Attributes:
        diagonal: blocks of A, ``(node, field, field)``.
        upper: blocks above them, ``(node - 1, field, field)``; zero between episodes.
        border: B, ``(node, field, shared)``.
        corner: C, ``(shared, shared)``.
        node_gradient: a, minus half the gradient, ``(node, field)``.
        shared_gradient: b, ``(shared,)``.
        cost: F there.
        damped: what Levenberg–Marquardt's damping multiplies, ``(node, field)``; None for the
            diagonal of A.
    """

    diagonal: Array
    upper: Array
    border: Array
    corner: Array
    node_gradient: Array
    shared_gradient: Array
    cost: float
    damped: Array | None = None

    def step(self, damping: float) -> tuple[Array, Array] | None:
        """Return the Levenberg–Marquardt step, ``(node, field)`` and ``(shared,)``.

        None where rounding has left the matrix without a Cholesky factor.
        """
        nodes, fields = self.node_gradient.shape
        band = self._band.copy()
        band[-1] += damping * (self._band[-1] if self.damped is None else self.damped.ravel())
        right = np.concatenate([self._flat_border, self.node_gradient.reshape(-1, 1)], axis=1)
        try:
            solved = cho_solve_banded((cholesky_banded(band), False), right)
            corner = self.corner + damping * np.diag(self.corner.diagonal())
            corner = corner - self._flat_border.T @ solved[:, :-1]
            rest = self.shared_gradient - self._flat_border.T @ solved[:, -1]
            shared = _solve(corner, rest) if len(rest) else rest
        except (LinAlgError, ValueError):
            return None
        return (solved[:, -1] - solved[:, :-1] @ shared).reshape(nodes, fields), shared

    def decrease(self, step: tuple[Array, Array]) -> float:
        """Return by how much F falls in a step without damping, if it is as linearised."""
        nodes, shared = step
        return float(self.node_gradient.ravel() @ nodes.ravel() + self.shared_gradient @ shared)

    def profiled(self, kept: int | None = None) -> tuple[Array, Array, float] | None:
        """Return G, g and c of ``F(δξ) = c - 2 gᵀδξ + δξᵀ G δξ``, the nodes at their best.

        None where rounding has left a matrix without a Cholesky factor.

        Args:
            kept: so many of the shared unknowns remain, and the others are at their best, too;
                None keeps all.
        """
        right = np.concatenate([self._flat_border, self.node_gradient.reshape(-1, 1)], axis=1)
        try:
            solved = cho_solve_banded((cholesky_banded(self._band), False), right)
        except (LinAlgError, ValueError):
            return None
        gram = self.corner - self._flat_border.T @ solved[:, :-1]
        target = self.shared_gradient - self._flat_border.T @ solved[:, -1]
        cost = self.cost - float(self.node_gradient.ravel() @ solved[:, -1])
        gram = (gram + gram.T) / 2
        return _eliminate(gram, target, cost, len(target) if kept is None else kept)

    def node_response(self) -> Array | None:
        """Return ``dx/dξ = -A⁻¹ B`` of the nodes at their best, ``(node, field, shared)``.

        None where rounding has left A without a Cholesky factor.
        """
        try:
            solved = cho_solve_banded((cholesky_banded(self._band), False), self._flat_border)
        except (LinAlgError, ValueError):
            return None
        return -solved.reshape(self.border.shape)

    def minimum(self) -> float | None:
        """Return min F of the linearised problem; None without a Cholesky factor."""
        profiled = self.profiled(0)
        return None if profiled is None else profiled[2]

    def covariance(self, components: Sequence[int]) -> Array | None:
        """Return the covariance of some components at every node; None without a factor.

        Args:
            components: indices among the unknowns of a node.

        Returns:
            The blocks, ``(node, component, component)``.
        """
        nodes, fields = self.node_gradient.shape
        rows = (np.arange(nodes)[:, None] * fields + list(components)).ravel()
        right = np.zeros((nodes * fields, len(rows)))
        right[rows, np.arange(len(rows))] = 1.0
        try:
            factor = cholesky_banded(self._band)
            columns = cho_solve_banded((factor, False), right)
            found = columns[rows]
            if len(self.corner):
                border = self._flat_border
                gram = self.corner - border.T @ cho_solve_banded((factor, False), border)
                shared = border.T @ columns
                found = found + shared.T @ _solve(gram, shared)
        except (LinAlgError, ValueError):
            return None
        count = len(components)
        blocks = found.reshape(nodes, count, nodes, count)
        return np.einsum("kikj->kij", blocks)

    def log_determinant(self) -> float | None:
        """Return ``ln det A``; None where rounding has left A without a Cholesky factor."""
        try:
            factor = cholesky_banded(self._band)
        except (LinAlgError, ValueError):
            return None
        return 2 * float(np.log(factor[-1]).sum())

    @cached_property
    def _flat_border(self) -> Array:
        return self.border.reshape(self.node_gradient.size, self.border.shape[-1])

    @cached_property
    def _band(self) -> Array:
        """A in LAPACK's upper banded storage, ``(2·field, node·field)``."""
        nodes, fields = self.node_gradient.shape
        band = np.zeros((2 * fields, nodes, fields))
        for column in range(fields):
            for row in range(fields):
                if row <= column:
                    offset = 2 * fields - 1 + row - column
                    band[offset, :, column] = self.diagonal[:, row, column]
                offset = fields - 1 + row - column
                if nodes > 1:
                    band[offset, 1:, column] = self.upper[:, row, column]
        return band.reshape(2 * fields, -1)


def _solve(matrix: Array, right: Array) -> Array:
    """Solve with a positive definite matrix whose unknowns have very different units.

    Raises:
        LinAlgError: rounding has left the matrix without a Cholesky factor.
    """
    size = np.sqrt(np.maximum(matrix.diagonal(), TINY))
    factor = cho_factor(matrix / size[:, None] / size)
    by_row = size.reshape(-1, *(1,) * (right.ndim - 1))
    solved: Array = cho_solve(factor, right / by_row) / by_row
    return solved


def _eliminate(
    gram: Array, target: Array, cost: float, kept: int
) -> tuple[Array, Array, float] | None:
    """Return G, g and c in the first unknowns, with the others at their best; None if singular."""
    border, rest = gram[:kept, kept:], target[kept:]
    if not len(rest):
        return gram, target, cost
    right = np.concatenate([border.T, rest[:, None]], axis=1)
    try:
        solved = _solve(gram[kept:, kept:], right)
    except (LinAlgError, ValueError):
        return None
    inner = gram[:kept, :kept] - border @ solved[:, :-1]
    return (
        (inner + inner.T) / 2,
        target[:kept] - border @ solved[:, -1],
        cost - float(rest @ solved[:, -1]),
    )
