"""Regularised least squares through the simulator, by Levenberg–Marquardt steps in batches.

The objective of every fit (design §4.2), in the unknowns ``φ = (z, ξ)``::

    F(φ) = ‖W(H S(φ) - y)‖² + ‖z‖² + ‖ξ/d‖²

A run of several trajectories costs little more than one, so a step tries a whole ladder of
dampings at once, and the fits of many sets of candidates share one Jacobian (chord steps).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from dashred.discovery.noise_model import NoiseModel
from dashred.discovery.shooting import Linearisation, Shooting

# One run tries all of these; in units of the curvature of each unknown.
LADDER = (0.0, 0.1, 3.0)
# A chord fit that needs more than this goes nowhere.
MOST_DAMPED = 10.0


class Trials(NamedTuple):
    """Runs of a batch.

    Attributes:
        readings: ``(batch, time, sensor)``.
        residuals: whitened, ``(batch, time·sensor)``.
    """

    readings: Tensor
    residuals: Tensor


@dataclass(frozen=True)
class Objective:
    """What a fit minimises.

    Attributes:
        shooting: from unknowns to readings.
        recorded: y, ``(time, sensor)``; NaN where missing.
        noise: W, whitening.
        prior_std: d of every candidate, ``(candidate,)``, in the user's units.
    """

    shooting: Shooting
    recorded: Tensor
    noise: NoiseModel
    prior_std: Tensor

    @property
    def modes(self) -> int:
        """Unknowns of the start."""
        return self.shooting.start.size

    def only(self, members: Sequence[int]) -> Objective:
        """Return F with some of the candidates alone."""
        candidates = [self.shooting.candidates[j] for j in members]
        shooting = replace(self.shooting, candidates=candidates)
        return replace(self, shooting=shooting, prior_std=self.prior_std[list(members)])

    def until(self, samples: int) -> Objective:
        """Return F over the first samples alone."""
        return replace(
            self,
            shooting=self.shooting.until(samples),
            recorded=self.recorded[:samples],
            noise=self.noise.first(samples),
        )

    def embed(self, phi: Tensor, members: Sequence[int]) -> Tensor:
        """Return unknowns of :meth:`only` some candidates among those of all."""
        whole = torch.zeros(self.modes + len(self.prior_std), dtype=torch.float64)
        whole[self.places(members)] = phi
        return whole

    def places(self, members: Sequence[int]) -> list[int]:
        """Return the indices of the start and of some candidates among the unknowns."""
        return [*range(self.modes), *(self.modes + j for j in members)]

    def split(self, phi: Tensor) -> tuple[Tensor, Tensor]:
        """Return z and ξ of unknowns ``(…, mode + candidate)``."""
        return phi[..., : self.modes], phi[..., self.modes :]

    def residuals(self, readings: Tensor) -> Tensor:
        """Return ``W(H S - y)``, ``(…, time·sensor)``."""
        return self.noise.whiten(readings - self.recorded).flatten(-2)

    def penalty(self, phi: Tensor) -> Tensor:
        """Return ``‖z‖² + ‖ξ/d‖²``, ``(…)``."""
        z, xi = self.split(phi)
        return z.square().sum(dim=-1) + (xi / self.prior_std).square().sum(dim=-1)

    def values(self, phi: Float[Tensor, "batch unknown"]) -> tuple[Tensor, Trials]:
        """Return F ``(batch,)``, infinite where a trajectory blows up, and what it is made of."""
        readings = self.shooting.readings(*self.split(phi))
        residuals = self.residuals(readings)
        cost = residuals.square().sum(dim=-1) + self.penalty(phi)
        return torch.where(torch.isfinite(cost), cost, torch.inf), Trials(readings, residuals)


@dataclass(frozen=True)
class Normal:
    """The normal equations about one point: ``(JᵀWᵀWJ + P) δ = -(JᵀWᵀ r + P φ)``.

    Attributes:
        jacobian: whitened, ``(time·sensor, unknown)``.
        precision: diagonal of P, ``(unknown,)``.
    """

    jacobian: Tensor
    precision: Tensor

    @classmethod
    def of(cls, objective: Objective, point: Linearisation) -> Normal:
        """Whiten the Jacobian of a linearisation."""
        columns = torch.cat([point.by_start, point.by_error], dim=-1).movedim(-1, 0)
        jacobian = objective.noise.whiten(columns).flatten(1).T
        ones = torch.ones(objective.modes, dtype=torch.float64)
        precision = torch.cat([ones, objective.prior_std.double() ** -2])
        return cls(jacobian, precision)

    @property
    def hessian(self) -> Tensor:
        """``JᵀWᵀWJ + P``, ``(unknown, unknown)``."""
        return self.jacobian.T @ self.jacobian + torch.diag(self.precision)

    def steps(
        self,
        phi: Float[Tensor, "batch unknown"],
        residuals: Float[Tensor, "batch sample"],
        damping: Float[Tensor, " batch"],
        free: Bool[Tensor, "batch unknown"],
    ) -> Tensor:
        """Return δ of each row, in the unknowns that it may move."""
        gradient = residuals @ self.jacobian + self.precision * phi
        hessian = self.hessian
        size = hessian.diagonal().sqrt()
        scaled = hessian / size[:, None] / size
        moved = free.to(phi.dtype)
        eye = torch.eye(len(size), dtype=phi.dtype)
        system = scaled * moved[:, :, None] * moved[:, None, :]
        system = system + eye * ((1 - moved) + damping[:, None])[:, None, :]
        right = -(gradient / size * moved)
        return torch.linalg.solve(system, right[..., None])[..., 0] / size


@dataclass(frozen=True)
class Fitted:
    """Where a fit has ended.

    Attributes:
        phi: the unknowns, ``(unknown,)``.
        cost: F there.
        chi2: its part ``‖W(H S - y)‖²``.
        readings: ``(time, sensor)``.
        converged: the last step lowered F by less than was asked for.
    """

    phi: Tensor
    cost: float
    chi2: float
    readings: Tensor
    converged: bool


def minimise(
    objective: Objective, phi: Float[Tensor, " unknown"], steps: int, tolerance: float
) -> Fitted:
    """Minimise F with a fresh Jacobian at every step.

    Args:
        objective: F.
        phi: where to begin.
        steps: Jacobians at most.
        tolerance: a step that lowers F by less than this, relatively, is the last.
    """
    damping = torch.tensor(LADDER, dtype=torch.float64)
    free = torch.ones((len(LADDER), len(phi)), dtype=torch.bool)
    fitted = Fitted(phi, torch.inf, torch.inf, torch.empty(0), False)
    for _ in range(steps):
        point = objective.shooting.linearise(*objective.split(phi))
        if not torch.isfinite(point.by_start).all() or not torch.isfinite(point.by_error).all():
            return fitted
        residuals = objective.residuals(point.readings)
        chi2 = float(residuals.square().sum())
        cost = chi2 + float(objective.penalty(phi))
        rows = phi.expand(len(LADDER), -1)
        step = Normal.of(objective, point).steps(
            rows, residuals.expand(len(LADDER), -1), damping, free
        )
        costs, trials = objective.values(rows + step)
        best = int(costs.argmin())
        gain = cost - float(costs[best])
        fitted = Fitted(phi, cost, chi2, point.readings, gain < tolerance * cost)
        if gain > 0:
            phi, chi2 = rows[best] + step[best], float(trials.residuals[best].square().sum())
            readings = trials.readings[best]
            fitted = Fitted(phi, float(costs[best]), chi2, readings, fitted.converged)
        if fitted.converged:
            break
    return fitted


@dataclass(frozen=True)
class Refits:
    """Fits of many sets of candidates.

    Attributes:
        phi: ``(set, unknown)``; zero for candidates not in the set.
        cost: F, ``(set,)``.
        chi2: ``(set,)``.
        converged: ``(set,)``.
    """

    phi: Tensor
    cost: Tensor
    chi2: Tensor
    converged: Tensor


def chord_refits(
    objective: Objective,
    normal: Normal,
    phi: Float[Tensor, "set unknown"],
    free: Bool[Tensor, "set unknown"],
    steps: int,
    tolerance: float,
    hopeless: float,
) -> Refits:
    """Minimise F over many sets of unknowns at once, with one Jacobian for all.

    Each step costs one batched run. A row whose step does not lower F is damped ten times more.

    Args:
        objective: F.
        normal: the normal equations about a point near all of them.
        phi: where each begins.
        free: which unknowns each may move.
        steps: runs at most.
        tolerance: a row that gains less than this in F is done, absolutely.
        hopeless: a row that would not come this near to the best, did it gain as much again, is
            given up.
    """
    damping = torch.zeros(len(phi), dtype=torch.float64)
    cost, (_, residuals) = objective.values(phi)
    done = torch.zeros(len(phi), dtype=torch.bool)
    for _ in range(steps):
        rows = torch.nonzero(~done).flatten()
        if not len(rows):
            break
        finite = torch.where(torch.isfinite(residuals[rows]), residuals[rows], 0.0)
        trial = phi[rows] + normal.steps(phi[rows], finite, damping[rows], free[rows])
        costs, (_, found) = objective.values(trial)
        gain = cost[rows] - costs
        better = gain > 0
        phi, cost, residuals = phi.clone(), cost.clone(), residuals.clone()
        phi[rows[better]], cost[rows[better]] = trial[better], costs[better]
        residuals[rows[better]] = found[better]
        # After a damped step a small gain says nothing about the next.
        done[rows] = better & (gain < tolerance) & (damping[rows] < 1)
        done[rows] |= damping[rows] > MOST_DAMPED
        done[rows] |= better & (cost[rows] - gain > cost.min() + hopeless)
        damping[rows] = torch.where(
            better, damping[rows] / 10, torch.clamp(damping[rows] * 10, min=0.1)
        )
    return Refits(phi, cost, residuals.square().sum(dim=-1), done)
