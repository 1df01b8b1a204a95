"""A linearised fit to which further unknowns are added cheaply.

The unknowns of the fit are eliminated once, by an orthogonal basis Q of the columns of J and of its
prior. Further columns C, such as the error of a sensor, then need small matrices only::

    C' = C - Q Qᵀ C        S = C'ᵀC'        c = (S + P)⁻¹ C'ᵀ r        F = ‖r‖² - cᵀ C'ᵀ r
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from dashred.inference.fit.least_squares import NormalEquations
from dashred.inference.fit.normal_equations import solve


@dataclass(frozen=True)
class Columns:
    """Further unknowns of a linearised fit.

    Attributes:
        matrix: derivative of the whitened readings, ``(time·sensor, parameter)``.
        offset: what is added to the target, because they are linearised about a first guess,
            ``(time·sensor,)``.
        precision: diagonal of the prior's precision, ``(parameter,)``.
    """

    matrix: Tensor
    offset: Tensor
    precision: Tensor


@dataclass(frozen=True)
class Estimate:
    """The minimum of a linearised fit over further unknowns and all others.

    Attributes:
        cost: the minimum of F.
        parameters: the further unknowns there, ``(parameter,)``.
        covariance: their posterior covariance, ``(parameter, parameter)``.
        information: S, ``(parameter, parameter)``.
    """

    cost: float
    parameters: Tensor
    covariance: Tensor
    information: Tensor


@dataclass(frozen=True)
class LinearisedFit:
    """``F(φ) = ‖J φ - b‖² + φᵀP φ``.

    Attributes:
        jacobian: J, whitened, ``(time·sensor, unknown)``.
        target: b, ``(time·sensor,)``.
        precision: diagonal of P, ``(unknown,)``.
    """

    jacobian: Tensor
    target: Tensor
    precision: Tensor

    @classmethod
    def of(cls, normal: NormalEquations) -> LinearisedFit:
        """Return F linearised at a point."""
        return cls(normal.jacobian, normal.target, normal.precision)

    @cached_property
    def cost(self) -> float:
        """The minimum of F."""
        return float(self._residual.square().sum())

    def estimate(self, columns: Columns) -> Estimate:
        """Return the minimum over further unknowns and all others."""
        added = self._without_fitted(columns.matrix)
        residual = self._residual + self._without_fitted(columns.offset[:, None])[:, 0]
        information, goal = added.T @ added, added.T @ residual
        hessian = information + torch.diag(columns.precision)
        covariance = solve(hessian, torch.eye(len(hessian), dtype=hessian.dtype))
        parameters = covariance @ goal
        cost = float(residual.square().sum() - goal @ parameters)
        return Estimate(cost, parameters, covariance, information)

    def with_columns(self, columns: Columns) -> LinearisedFit:
        """Return F with further unknowns."""
        return LinearisedFit(
            torch.cat([self.jacobian, columns.matrix], dim=1),
            self.target + columns.offset,
            torch.cat([self.precision, columns.precision]),
        )

    def without_rows(self, removed: Tensor) -> LinearisedFit:
        """Return F without some samples, ``(time·sensor,)``."""
        kept = (~removed).to(self.target.dtype)
        return LinearisedFit(self.jacobian * kept[:, None], self.target * kept, self.precision)

    def residual_without(self, rows: Tensor, others: Tensor) -> Tensor:
        """Return the target of some rows minus its prediction by other rows, both as masks."""
        jacobian, target = self.jacobian[others], self.target[others]
        matrix = jacobian.T @ jacobian + torch.diag(self.precision)
        phi = solve(matrix, (jacobian.T @ target)[:, None])[:, 0]
        return self.target[rows] - self.jacobian[rows] @ phi

    @cached_property
    def _basis(self) -> Tensor:
        rows = torch.cat([self.jacobian, torch.diag(self.precision.sqrt())])
        basis: Tensor = torch.linalg.qr(rows)[0]
        return basis

    @cached_property
    def _residual(self) -> Tensor:
        """Residual of the target and of the prior at the minimum."""
        return self._without_fitted(self.target[:, None])[:, 0]

    def _without_fitted(self, columns: Tensor) -> Tensor:
        """Return columns minus their fit by the unknowns, ``(time·sensor + unknown, column)``."""
        basis = self._basis
        whole = columns.new_zeros((len(basis), columns.shape[1]))
        whole[: len(columns)] = columns
        # Twice: the first difference keeps rounding errors of the part that was removed.
        for _ in range(2):
            whole = whole - basis @ (basis.T @ whole)
        return whole
