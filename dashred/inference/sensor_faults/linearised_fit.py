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
    """

    matrix: Tensor
    offset: Tensor


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
        both = self._without_fitted(torch.cat([columns.matrix, columns.offset[:, None]], dim=1))
        added, residual = both[:, :-1], self._residual + both[:, -1]
        return Profile(float(residual.square().sum()), added.T @ residual, added.T @ added)

    def with_columns(self, columns: Columns, scales: Tensor) -> LinearisedFit:
        """Return F with further unknowns, whose prior has these standard deviations."""
        return LinearisedFit(
            torch.cat([self.jacobian, columns.matrix], dim=1),
            self.target + columns.offset,
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
