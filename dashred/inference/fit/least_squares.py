"""The least-squares problem, and its normal equations at a point.

Every fit minimises a regularised sum of squares over the unknowns ``φ = (z, ξ)``: z of the start
and of uncertain parameters, and the coefficients ξ
(docs/method.md#fit-through-the-simulator)::

    F(φ) = ‖W(H S(φ) - y)‖² + ‖z‖² + ‖ξ/d‖²
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from dashred.core.budget import NEVER, Deadline
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.fit.normal_equations import solve
from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.forward_model import ForwardModel
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.initial_state.start_models import StartModel


class Trials(NamedTuple):
    """Readings and residuals of a batch of trial points.

    Attributes:
        readings: ``(batch, time, sensor)``.
        residuals: whitened, ``(batch, time·sensor)``.
    """

    readings: Tensor
    residuals: Tensor


# A larger residual, in units of σ, comes from a trajectory that blows up. Its square overflows.
LARGEST = 1e140


@dataclass(frozen=True)
class LeastSquaresProblem:
    """The function F that a fit minimises.

    Attributes:
        forward_model: maps unknowns to readings.
        recorded: y, ``(time, sensor)``; NaN where missing.
        noise: W, whitens residuals.
        prior_std: d, the prior std of every coefficient, ``(coefficient,)``, in the user's units.
        deadline: time at which fits of it end.
    """

    forward_model: ForwardModel
    recorded: Tensor
    noise: NoiseModel
    prior_std: Tensor
    deadline: Deadline = NEVER

    @property
    def modes(self) -> int:
        """Number of unknowns of the start and the uncertain parameters."""
        return self.forward_model.modes

    @property
    def precision(self) -> Tensor:
        """Diagonal of P, the prior's precision, ``(unknown,)``."""
        ones = torch.ones(self.modes, dtype=torch.float64)
        return torch.cat([ones, self.prior_std.double() ** -2])

    def subset(self, members: Sequence[int]) -> LeastSquaresProblem:
        """Return F with some of its candidates, by index; F must have no other coefficients."""
        law = LawBlock([self.forward_model.law.candidates[j] for j in members])
        forward_model = replace(self.forward_model, law=law)
        return replace(self, forward_model=forward_model, prior_std=self.prior_std[list(members)])

    def with_candidates(self, candidates: Sequence[Candidate]) -> LeastSquaresProblem:
        """Return F with other candidates; the prior std of each is its scale."""
        simulator, law = (
            self.forward_model.simulator.with_candidates(candidates),
            LawBlock(candidates),
        )
        forward_model = replace(self.forward_model, simulator=simulator, law=law)
        return replace(self, forward_model=forward_model, prior_std=law.scales)

    def with_start(self, start: StartModel) -> LeastSquaresProblem:
        """Return F with another start model."""
        return replace(self, forward_model=replace(self.forward_model, start=start))

    def with_unknowns(self, forward_model: ForwardModel, stds: Tensor) -> LeastSquaresProblem:
        """Return F with further unknowns, after those of this F.

        Args:
            forward_model: forward model with the block of the further unknowns.
            stds: prior standard deviations of the further unknowns, ``(unknown,)``.
        """
        prior_std = torch.cat([self.prior_std, stds])
        return replace(self, forward_model=forward_model, prior_std=prior_std)

    def truncate(self, samples: int) -> LeastSquaresProblem:
        """Return F over the first samples."""
        return replace(
            self,
            forward_model=self.forward_model.truncate(samples),
            recorded=self.recorded[:samples],
            noise=self.noise.truncate(samples),
        )

    def embed(self, phi: Tensor, members: Sequence[int]) -> Tensor:
        """Return the unknowns of :meth:`subset` as unknowns of this F, zero elsewhere."""
        whole = torch.zeros(self.modes + len(self.prior_std), dtype=torch.float64)
        whole[self.indices(members)] = phi
        return whole

    def indices(self, members: Sequence[int]) -> list[int]:
        """Return the indices of z and of some candidates among the unknowns."""
        return [*range(self.modes), *(self.modes + j for j in members)]

    def split(self, phi: Tensor) -> tuple[Tensor, Tensor]:
        """Return z and ξ of unknowns ``(…, mode + coefficient)``."""
        return phi[..., : self.modes], phi[..., self.modes :]

    def residuals(self, readings: Tensor) -> Tensor:
        """Return ``W(H S - y)``, ``(…, time·sensor)``."""
        return self.noise.whiten(readings - self.recorded).flatten(-2)

    def estimate_noise(self, readings: Tensor, parameters: float) -> NoiseModel:
        """Return the noise model that the residuals of a fit imply.

        Args:
            readings: readings of the fit, ``(time, sensor)``.
            parameters: effective number of fitted parameters
                (:meth:`NormalEquations.effective_parameters`).
        """
        groups = [sensor.reads for sensor in self.forward_model.sensors.sensors]
        return self.noise.estimate(readings - self.recorded, groups, parameters)

    def penalty(self, phi: Tensor) -> Tensor:
        """Return ``‖z‖² + ‖ξ/d‖²``, ``(…)``."""
        z, xi = self.split(phi)
        return z.square().sum(dim=-1) + (xi / self.prior_std).square().sum(dim=-1)

    def linearise(
        self, phi: Tensor, readings: Tensor | None = None, deadline: Deadline = NEVER
    ) -> NormalEquations:
        """Return the normal equations at a point.

        Args:
            phi: the point, ``(unknown,)``.
            readings: readings at the point, ``(time, sensor)``, if they are known already.
            deadline: time at which the integration of the derivatives ends.

        Raises:
            OutOfTimeError: the deadline is over.
        """
        point = self.forward_model.linearise(*self.split(phi), readings, deadline)
        columns = torch.cat([point.by_start, point.by_coefficients], dim=-1).movedim(-1, 0)
        jacobian = self.noise.whiten(columns).flatten(1).T
        residuals = self.residuals(point.readings)
        finite = bool(_in_bounds(jacobian).all() and _in_bounds(residuals).all())
        return NormalEquations(
            _zero_out_of_bounds(jacobian),
            self.precision,
            phi,
            _zero_out_of_bounds(residuals),
            finite,
        )

    def values(self, phi: Float[Tensor, "batch unknown"]) -> tuple[Tensor, Trials]:
        """Return F, ``(batch,)``, and the readings and residuals; F is inf after a blow-up."""
        readings = self.forward_model.readings(*self.split(phi))
        residuals = self.residuals(readings)
        cost = residuals.square().sum(dim=-1) + self.penalty(phi)
        return torch.where(torch.isfinite(cost), cost, torch.inf), Trials(readings, residuals)


@dataclass(frozen=True)
class NormalEquations:
    """F linearised at one point: ``F(φ) ≈ ‖J φ - b‖² + φᵀP φ`` with ``b = J φ₀ - r``.

    Attributes:
        jacobian: J, whitened, ``(time·sensor, unknown)``.
        precision: diagonal of P, ``(unknown,)``.
        phi: the point φ₀, ``(unknown,)``.
        residuals: r at φ₀, whitened, ``(time·sensor,)``.
        is_finite: whether J and r are finite; entries that are not are set to zero.
    """

    jacobian: Tensor
    precision: Tensor
    phi: Tensor
    residuals: Tensor
    is_finite: bool = True

    def with_precision(self, precision: Tensor) -> NormalEquations:
        """Return F with another prior, ``(unknown,)``; the products of J are computed once."""
        changed = replace(self, precision=precision)
        shared = {"gram": self.gram, "target": self.target, "right_side": self.right_side}
        changed.__dict__.update(shared)
        return changed

    @cached_property
    def gram(self) -> Tensor:
        """``JᵀJ``, ``(unknown, unknown)``."""
        return self.jacobian.T @ self.jacobian

    @cached_property
    def hessian(self) -> Tensor:
        """``JᵀJ + P``, ``(unknown, unknown)``."""
        return self.gram + torch.diag(self.precision)

    @cached_property
    def target(self) -> Tensor:
        """The right-hand side b, ``(time·sensor,)``."""
        return self.jacobian @ self.phi - self.residuals

    def solution(self, index: Sequence[int]) -> Tensor:
        """Return the minimiser over some unknowns, with the others zero: ``(len(index),)``."""
        chosen = list(index)
        return solve(self.hessian[chosen][:, chosen], self.right_side[chosen, None])[:, 0]

    def minimum(self) -> float:
        """Return the minimum of the linearised F."""
        return self.minimum_over(range(len(self.phi)))

    def minimum_over(self, index: Sequence[int]) -> float:
        """Return the minimum of the linearised F over some unknowns, with the others zero."""
        chosen = list(index)
        gain = self.right_side[chosen] @ self.solution(chosen)
        return float(self.target.square().sum() - gain)

    def covariance(self, index: Sequence[int]) -> Tensor:
        """Return the posterior covariance ``(JᵀJ + P)⁻¹`` of some unknowns; the others are 0."""
        chosen = list(index)
        hessian = self.hessian[chosen][:, chosen]
        size = hessian.diagonal().sqrt()
        eye = torch.eye(len(size), dtype=hessian.dtype)
        return solve(hessian / size[:, None] / size, eye) / size[:, None] / size

    def effective_parameters(self, index: Sequence[int]) -> float:
        """Return the effective number of parameters of a fit of some unknowns.

        ``γ = tr (JᵀJ + P)⁻¹ JᵀJ`` (MacKay, *Bayesian interpolation*, 1992). Directions that the
        readings do not determine keep their prior values and do not count. The residuals of n
        readings have ``E‖r‖² = n - γ``.
        """
        chosen = list(index)
        # From singular values: a chaotic run makes J large, and P is lost in JᵀJ by rounding.
        seen = torch.linalg.svdvals(self.jacobian[:, chosen] / self.precision[chosen].sqrt())
        return float((seen**2 / (1 + seen**2)).sum())

    def steps(
        self,
        phi: Float[Tensor, "batch unknown"],
        residuals: Float[Tensor, "batch sample"],
        damping: Float[Tensor, " batch"],
        free: Bool[Tensor, "batch unknown"],
    ) -> Tensor:
        """Return the step ``δ = -(JᵀJ + P)⁻¹(Jᵀr + Pφ)`` of each row, in its free unknowns.

        Args:
            phi: the point of each row.
            residuals: r at these points, whitened.
            damping: Levenberg–Marquardt damping, in units of the curvature of each unknown.
            free: the free unknowns of each row.
        """
        gradient = residuals @ self.jacobian + self.precision * phi
        size = self.hessian.diagonal().sqrt()
        scaled = self.hessian / size[:, None] / size
        moved = free.to(phi.dtype)
        eye = torch.eye(len(size), dtype=phi.dtype)
        system = scaled * moved[:, :, None] * moved[:, None, :]
        system = system + eye * ((1 - moved) + damping[:, None])[:, None, :]
        right = -(gradient / size * moved)
        return solve(system, right[..., None])[..., 0] / size

    @cached_property
    def right_side(self) -> Tensor:
        """``Jᵀb``, ``(unknown,)``."""
        return self.jacobian.T @ self.target


def _in_bounds(values: Tensor) -> Tensor:
    """Return which values are finite and have a finite square."""
    return values.abs() < LARGEST


def _zero_out_of_bounds(values: Tensor) -> Tensor:
    return torch.where(_in_bounds(values), values, 0.0)
