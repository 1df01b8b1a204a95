"""What every fit minimises, and its normal equations about a point.

Regularised least squares through the simulator, in the unknowns ``φ = (z, ξ)``
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

from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.fit.normal_equations import solve
from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.forward_model import ForwardModel
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.initial_state.start_models import StartModel


class Trials(NamedTuple):
    """Runs of a batch.

    Attributes:
        readings: ``(batch, time, sensor)``.
        residuals: whitened, ``(batch, time·sensor)``.
    """

    readings: Tensor
    residuals: Tensor


# What is larger, in noise's σ, comes of a trajectory that is about to blow up: squares overflow.
LARGEST = 1e140


@dataclass(frozen=True)
class LeastSquaresProblem:
    """What a fit minimises.

    Attributes:
        forward_model: from unknowns to readings.
        recorded: y, ``(time, sensor)``; NaN where missing.
        noise: W, whitening.
        prior_std: d of every coefficient, ``(coefficient,)``, in the user's units.
    """

    forward_model: ForwardModel
    recorded: Tensor
    noise: NoiseModel
    prior_std: Tensor

    @property
    def modes(self) -> int:
        """Unknowns of the start."""
        return self.forward_model.start.size

    @property
    def precision(self) -> Tensor:
        """Diagonal of P, the prior's precision, ``(unknown,)``."""
        ones = torch.ones(self.modes, dtype=torch.float64)
        return torch.cat([ones, self.prior_std.double() ** -2])

    def subset(self, members: Sequence[int]) -> LeastSquaresProblem:
        """Return F with some of the candidates alone; those of F are its only coefficients."""
        law = LawBlock([self.forward_model.law.candidates[j] for j in members])
        forward_model = replace(self.forward_model, law=law)
        return replace(self, forward_model=forward_model, prior_std=self.prior_std[list(members)])

    def with_candidates(self, candidates: Sequence[Candidate]) -> LeastSquaresProblem:
        """Return F of others, alone in the simulator's reach; their prior is their scale."""
        simulator, law = (
            self.forward_model.simulator.with_candidates(candidates),
            LawBlock(candidates),
        )
        forward_model = replace(self.forward_model, simulator=simulator, law=law)
        return replace(self, forward_model=forward_model, prior_std=law.scales)

    def with_start(self, start: StartModel) -> LeastSquaresProblem:
        """Return F about another start."""
        return replace(self, forward_model=replace(self.forward_model, start=start))

    def with_unknowns(self, forward_model: ForwardModel, stds: Tensor) -> LeastSquaresProblem:
        """Return F of a forward model with further unknowns, behind those of this one.

        Args:
            forward_model: with the block that the unknowns belong to.
            stds: their prior standard deviations, ``(unknown,)``.
        """
        prior_std = torch.cat([self.prior_std, stds])
        return replace(self, forward_model=forward_model, prior_std=prior_std)

    def truncate(self, samples: int) -> LeastSquaresProblem:
        """Return F over the first samples alone."""
        return replace(
            self,
            forward_model=self.forward_model.truncate(samples),
            recorded=self.recorded[:samples],
            noise=self.noise.truncate(samples),
        )

    def embed(self, phi: Tensor, members: Sequence[int]) -> Tensor:
        """Return unknowns of :meth:`subset` some candidates among those of all."""
        whole = torch.zeros(self.modes + len(self.prior_std), dtype=torch.float64)
        whole[self.indices(members)] = phi
        return whole

    def indices(self, members: Sequence[int]) -> list[int]:
        """Return the indices of the start and of some candidates among the unknowns."""
        return [*range(self.modes), *(self.modes + j for j in members)]

    def split(self, phi: Tensor) -> tuple[Tensor, Tensor]:
        """Return z and ξ of unknowns ``(…, mode + coefficient)``."""
        return phi[..., : self.modes], phi[..., self.modes :]

    def residuals(self, readings: Tensor) -> Tensor:
        """Return ``W(H S - y)``, ``(…, time·sensor)``."""
        return self.noise.whiten(readings - self.recorded).flatten(-2)

    def estimate_noise(self, readings: Tensor, spent: float) -> NoiseModel:
        """Return the noise that the residuals of a fit speak for: its size and correlation.

        Args:
            readings: of the fit, ``(time, sensor)``.
            spent: effective number of fitted parameters.
        """
        groups = [sensor.reads for sensor in self.forward_model.sensors.sensors]
        return self.noise.estimate(readings - self.recorded, groups, spent)

    def penalty(self, phi: Tensor) -> Tensor:
        """Return ``‖z‖² + ‖ξ/d‖²``, ``(…)``."""
        z, xi = self.split(phi)
        return z.square().sum(dim=-1) + (xi / self.prior_std).square().sum(dim=-1)

    def linearise(self, phi: Tensor, readings: Tensor | None = None) -> NormalEquations:
        """Return the normal equations about unknowns ``(unknown,)``.

        Args:
            phi: the point.
            readings: there, ``(time, sensor)``, where they are known already.
        """
        point = self.forward_model.linearise(*self.split(phi), readings)
        columns = torch.cat([point.by_start, point.by_coefficients], dim=-1).movedim(-1, 0)
        jacobian = self.noise.whiten(columns).flatten(1).T
        residuals = self.residuals(point.readings)
        finite = bool(_in_bounds(jacobian).all() and _in_bounds(residuals).all())
        return NormalEquations(_or_zero(jacobian), self.precision, phi, _or_zero(residuals), finite)

    def values(self, phi: Float[Tensor, "batch unknown"]) -> tuple[Tensor, Trials]:
        """Return F ``(batch,)``, infinite where a trajectory blows up, and what it is made of."""
        readings = self.forward_model.readings(*self.split(phi))
        residuals = self.residuals(readings)
        cost = residuals.square().sum(dim=-1) + self.penalty(phi)
        return torch.where(torch.isfinite(cost), cost, torch.inf), Trials(readings, residuals)


@dataclass(frozen=True)
class NormalEquations:
    """F linearised about one point: ``F(φ) ≈ ‖J φ - b‖² + φᵀP φ`` with ``b = J φ₀ - r``.

    Attributes:
        jacobian: J, whitened, ``(time·sensor, unknown)``.
        precision: diagonal of P, ``(unknown,)``.
        phi: the point φ₀, ``(unknown,)``.
        residuals: r there, whitened, ``(time·sensor,)``.
        is_finite: whether nothing blew up; what did is zero in J and r and so says nothing.
    """

    jacobian: Tensor
    precision: Tensor
    phi: Tensor
    residuals: Tensor
    is_finite: bool = True

    @cached_property
    def hessian(self) -> Tensor:
        """``JᵀJ + P``, ``(unknown, unknown)``."""
        return self.jacobian.T @ self.jacobian + torch.diag(self.precision)

    @cached_property
    def target(self) -> Tensor:
        """b, what the model would have to produce, were it linear, ``(time·sensor,)``."""
        return self.jacobian @ self.phi - self.residuals

    def solution(self, index: Sequence[int]) -> Tensor:
        """Return the minimum over some of the unknowns, the others zero: ``(len(index),)``."""
        chosen = list(index)
        return solve(self.hessian[chosen][:, chosen], self._goal[chosen, None])[:, 0]

    def minimum(self) -> float:
        """Return the minimum of F, were the model linear."""
        everything = range(len(self.phi))
        return float(self.target.square().sum() - self._goal @ self.solution(everything))

    def covariance(self, index: Sequence[int]) -> Tensor:
        """Return the posterior covariance ``(JᵀJ + P)⁻¹`` of some unknowns, the others zero."""
        chosen = list(index)
        hessian = self.hessian[chosen][:, chosen]
        size = hessian.diagonal().sqrt()
        eye = torch.eye(len(size), dtype=hessian.dtype)
        return solve(hessian / size[:, None] / size, eye) / size[:, None] / size

    def effective_parameters(self, index: Sequence[int]) -> float:
        """Return how many numbers a fit of some unknowns takes from the recording.

        ``γ = tr (JᵀJ + P)⁻¹ JᵀJ`` (MacKay, *Bayesian interpolation*, 1992): what the readings say
        nothing of stays where its prior has it, and is not taken from their residuals. Those of n
        readings have ``E‖r‖² = n - γ``.
        """
        chosen = list(index)
        # Singular values: of JᵀJ, where a chaotic run has made J large, rounding leaves no prior.
        seen = torch.linalg.svdvals(self.jacobian[:, chosen] / self.precision[chosen].sqrt())
        return float((seen**2 / (1 + seen**2)).sum())

    def steps(
        self,
        phi: Float[Tensor, "batch unknown"],
        residuals: Float[Tensor, "batch sample"],
        damping: Float[Tensor, " batch"],
        free: Bool[Tensor, "batch unknown"],
    ) -> Tensor:
        """Return ``δ = -(JᵀJ + P)⁻¹(Jᵀr + Pφ)`` of each row, in the unknowns that it may move.

        Args:
            phi: where each row is.
            residuals: r there.
            damping: Levenberg-Marquardt's, in units of each unknown's curvature.
            free: which unknowns each row may move.
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
    def _goal(self) -> Tensor:
        return self.jacobian.T @ self.target


def _in_bounds(values: Tensor) -> Tensor:
    """Tell what is finite, its square as well."""
    return values.abs() < LARGEST


def _or_zero(values: Tensor) -> Tensor:
    return torch.where(_in_bounds(values), values, 0.0)
