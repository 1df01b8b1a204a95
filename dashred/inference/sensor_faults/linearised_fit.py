"""A linearised fit to which further unknowns are added cheaply.

The unknowns of the fit are eliminated once, by an orthogonal basis Q of the columns of J and of its
prior. Further columns C, such as the error of a sensor, then need small matrices only::

    C' = C - Q Qᵀ C        S = C'ᵀC'        c = (S + P)⁻¹ C'ᵀ r        F = ‖r‖² - cᵀ C'ᵀ r

A sensor's error concerns the samples K of this sensor alone, so that only these rows of Q are
needed: ``S = CᵀC - GᵀG`` with ``G = Q_Kᵀ C``. Samples are left out without another fit, too::

    e_K = (I - Q_K Q_Kᵀ)⁻¹ r_K        F_{-K} = F - r_Kᵀ e_K

where e_K are their residuals about the prediction by all other samples.
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
    """Further unknowns of a linearised fit, which concern some of its samples.

    Attributes:
        rows: these samples, ``(row,)``.
        matrix: derivative of their whitened readings, ``(row, parameter)``.
        offset: what is added to their target, because they are linearised about a first guess,
            ``(row,)``.
    """

    rows: Tensor
    matrix: Tensor
    offset: Tensor

    @classmethod
    def of(cls, matrix: Tensor, offset: Tensor) -> Columns:
        """Return the columns of all samples, ``(time·sensor, parameter)``, without rows of zeros.

        Args:
            matrix: derivative of all whitened readings.
            offset: what is added to their target, ``(time·sensor,)``.
        """
        rows = torch.nonzero((matrix != 0).any(dim=1) | (offset != 0)).flatten()
        return cls(rows, matrix[rows], offset[rows])


@dataclass(frozen=True)
class Profile:
    """A linearised fit as a function of further unknowns, all others at their minimum.

    ``F(c) = power - 2 cᵀ goal + cᵀ S c``, without the prior of c.

    Attributes:
        power: F for c = 0.
        goal: ``(parameter,)``.
        information: S, ``(parameter, parameter)``.
    """

    power: float
    goal: Tensor
    information: Tensor

    def minimum(self, scales: Tensor) -> Estimate:
        """Return the minimum under a prior with these standard deviations, ``(parameter,)``."""
        hessian = self.information + torch.diag(scales**-2)
        covariance = solve(hessian, torch.eye(len(hessian), dtype=hessian.dtype))
        parameters = covariance @ self.goal
        return Estimate(self.power - float(self.goal @ parameters), parameters, covariance)


@dataclass(frozen=True)
class Estimate:
    """The minimum of F over further unknowns and all others.

    Attributes:
        cost: the minimum.
        parameters: the further unknowns there, ``(parameter,)``.
        covariance: their posterior covariance, ``(parameter, parameter)``.
    """

    cost: float
    parameters: Tensor
    covariance: Tensor


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

    def profile(self, columns: Columns) -> Profile:
        """Return F as a function of further unknowns."""
        matrix, offset = columns.matrix, columns.offset
        residual, basis = self._residual[columns.rows], self._basis[columns.rows]
        fitted, shifted = basis.T @ matrix, basis.T @ offset
        return Profile(
            self.cost + float(2 * residual @ offset + offset @ offset - shifted @ shifted),
            matrix.T @ (residual + offset) - fitted.T @ shifted,
            matrix.T @ matrix - fitted.T @ fitted,
        )

    def with_columns(self, columns: Columns, scales: Tensor) -> LinearisedFit:
        """Return F with further unknowns, whose prior has these standard deviations."""
        matrix = self.jacobian.new_zeros((len(self.target), columns.matrix.shape[1]))
        matrix[columns.rows] = columns.matrix
        return LinearisedFit(
            torch.cat([self.jacobian, matrix], dim=1),
            self.target.index_add(0, columns.rows, columns.offset),
            torch.cat([self.precision, scales**-2]),
        )

    def without_rows(self, removed: Tensor) -> LinearisedFit:
        """Return F without some samples, ``(time·sensor,)``."""
        kept = (~removed).to(self.target.dtype)
        return LinearisedFit(self.jacobian * kept[:, None], self.target * kept, self.precision)

    @property
    def misfit(self) -> Tensor:
        """Residual of the samples at the minimum, ``(time·sensor,)``."""
        return self._residual[: len(self.target)]

    def residual_without(self, removed: Tensor) -> Tensor:
        """Return the target of some samples minus their prediction by the others, ``(row,)``.

        Args:
            removed: mask of the samples, ``(time·sensor,)``.
        """
        rows = torch.nonzero(removed).flatten()
        basis, eye = self._basis[rows], torch.eye(len(rows), dtype=self.target.dtype)
        return solve(eye - basis @ basis.T, self._residual[rows, None])[:, 0]

    def misfit_without(self, removed: Tensor) -> Tensor:
        """Return the residual of the samples without some of them, whose own residual is 0."""
        samples, prediction = len(self.target), self.residual_without(removed)
        others = self._basis[:samples] @ (self._basis[:samples][removed].T @ prediction)
        return (self.misfit + others) * ~removed

    def cost_without(self, removed: Tensor) -> float:
        """Return the minimum of F without some samples, given as a mask ``(time·sensor,)``."""
        return self.cost - float(self.misfit[removed] @ self.residual_without(removed))

    @cached_property
    def _basis(self) -> Tensor:
        rows = torch.cat([self.jacobian, torch.diag(self.precision.sqrt())])
        basis: Tensor = torch.linalg.qr(rows)[0]
        return basis

    @cached_property
    def _residual(self) -> Tensor:
        """Residual of the target and of the prior at the minimum, ``(time·sensor + unknown,)``."""
        basis = self._basis
        whole = torch.cat([self.target, torch.zeros_like(self.precision)])
        # Twice: the first difference keeps rounding errors of the part that was removed.
        for _ in range(2):
            whole = whole - basis @ (basis.T @ whole)
        return whole
