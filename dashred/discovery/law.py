"""A law: some candidates with their coefficients, fitted together with the start."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from dashred.discovery.candidates import Candidate, forcing_of
from dashred.discovery.objective import Normal, Objective
from dashred.physics.forcing import Forcing

# Two-sided 95 % of a normal distribution.
Z95 = 1.959964


@dataclass(frozen=True)
class Law:
    """One explanation of the recording.

    Attributes:
        candidates: what is missing or mis-stated; empty for the simulator as it is.
        coefficients: ξ, ``(candidate,)``, in the user's units.
        covariance: posterior covariance of ξ, the start's uncertainty in it.
        start: state at the first sample, ``(field, *grid)``.
        score: ``F + k (ln n + 2 ln p)``; differences are ΔBIC.
        chi2: mean squared whitened residual over the fit; 1 for noise alone.
        residuals: readings minus recording over the fit, ``(time, sensor)``, NaN where missing.
    """

    candidates: tuple[Candidate, ...]
    coefficients: Tensor
    covariance: Tensor
    start: Tensor
    score: float
    chi2: float
    residuals: Tensor

    @property
    def std(self) -> Tensor:
        """Posterior standard deviations, ``(candidate,)``."""
        return self.covariance.diagonal().clamp(min=0).sqrt()

    def interval(self, index: int) -> tuple[float, float]:
        """Return the 95 % interval of one coefficient."""
        value, std = float(self.coefficients[index]), float(self.std[index])
        return value - Z95 * std, value + Z95 * std

    def forcing(self) -> Forcing | None:
        """Return the model error as the simulator takes it; None for the empty law."""
        if not self.candidates:
            return None
        return forcing_of(self.candidates, self.coefficients[None])

    def __str__(self) -> str:
        """``u: 0.0249*u - 0.0251*u**3``; ``nothing`` for the empty law."""
        parts = [
            f"{candidate} × {value:.4g}"
            for candidate, value in zip(self.candidates, self.coefficients.tolist(), strict=True)
        ]
        return ", ".join(parts) or "nothing"


def posterior(
    objective: Objective,
    normal: Normal,
    phi: Tensor,
    members: tuple[int, ...],
    readings: Tensor,
    score: float,
) -> Law:
    """Return the law at a minimum of F, its covariance from the Hessian.

    ``cov = (JᵀWᵀWJ + P)⁻¹`` over the start and the law's own coefficients (design §4.2.7).

    Args:
        objective: F.
        normal: normal equations about the minimum, or near it, of all candidates.
        phi: the minimum, ``(unknown,)``.
        members: candidates of the law.
        readings: there, ``(time, sensor)``.
        score: of the law.
    """
    shooting = objective.shooting
    z, xi = objective.split(phi)
    covariance = normal.covariance(objective.places(members))
    chi2 = float(objective.residuals(readings).square().sum()) / objective.noise.count
    return Law(
        candidates=tuple(shooting.candidates[j] for j in members),
        coefficients=xi[list(members)],
        covariance=covariance[objective.modes :, objective.modes :],
        start=shooting.start.start(z[None])[0],
        score=score,
        chi2=chi2,
        residuals=readings - objective.recorded,
    )
