"""The noise of sensors: its size, and its correlation from sample to sample."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

# Correlations below this many standard errors are taken for none.
SIGNIFICANT = 3.0
LARGEST_CORRELATION = 0.99


@dataclass(frozen=True)
class NoiseModel:
    """First-order autoregressive noise: ``e_t = ρ e_{t-1} + √(1-ρ²) σ η_t``, η ~ N(0, 1).

    Attributes:
        std: σ of each sensor, ``(sensor,)``, in the sensor's unit.
        correlation: ρ of each sensor between neighbouring samples, ``(sensor,)``.
        available: which samples there are, ``(time, sensor)``; a gap starts the sequence anew.
    """

    std: Tensor
    correlation: Tensor
    available: Tensor

    @property
    def count(self) -> int:
        """Samples there are."""
        return int(self.available.sum())

    @property
    def effective_count(self) -> float:
        """Independent samples that say as much: ``Σ n (1-ρ)/(1+ρ)`` over the sensors."""
        shares = (1 - self.correlation) / (1 + self.correlation)
        return float(self.available.sum(dim=0).double() @ shares)

    def truncate(self, samples: int) -> NoiseModel:
        """Return the model of the first samples alone."""
        return replace(self, available=self.available[:samples])

    def whiten(self, values: Float[Tensor, "*batch time sensor"]) -> Tensor:
        """Return values in units of independent noise of variance 1; missing ones are zero."""
        scaled = torch.where(self.available, values, 0.0) / self.std
        rho = self.correlation
        if not rho.any():
            return scaled
        follows = (self.available[1:] & self.available[:-1]).to(scaled.dtype)
        rest = scaled[..., 1:, :] - rho * scaled[..., :-1, :] * follows
        rest = rest / (1 - rho**2 * follows).sqrt()
        return torch.cat([scaled[..., :1, :], rest], dim=-2)

    def scaled(self, factor: float) -> NoiseModel:
        """Return the model with all σ multiplied."""
        return replace(self, std=self.std * factor)

    def estimate(
        self, residuals: Float[Tensor, "time sensor"], groups: list[str], parameters: float
    ) -> NoiseModel:
        """Return the model that the residuals of a fit speak for.

        Within what reads the same quantity σ keeps its ratios and takes its level from the
        residuals, and ρ is their pooled lag-one correlation, if it is significant. Of what is not
        seen at all, residuals say nothing: its σ stays.

        Args:
            residuals: readings minus recording.
            groups: what each sensor reads.
            parameters: how many the fit has spent; divided by the number of samples.
        """
        std, correlation = self.std.clone(), torch.zeros_like(self.std)
        left = max(1.0 - parameters / max(1, self.count), 0.1)
        squares = torch.where(self.available, residuals / self.std, 0.0).square()
        for group in dict.fromkeys(groups):
            mine = torch.tensor([g == group for g in groups])
            if not self.available[:, mine].any():
                continue
            mean = float(squares[:, mine].sum() / self.available[:, mine].sum())
            std[mine] *= max(math.sqrt(mean / left), 1e-12)
            scaled = residuals[:, mine] / std[mine]
            correlation[mine] = _lag_one(scaled, self.available[:, mine])
        return NoiseModel(std, correlation, self.available)


def _lag_one(scaled: Float[Tensor, "time sensor"], seen: Tensor) -> float:
    """Return the correlation of neighbours; 0 where it is not significant, or negative."""
    pairs = seen[1:] & seen[:-1]
    if not pairs.any():
        return 0.0
    products = float((scaled[1:] * scaled[:-1])[pairs].sum())
    power = float((scaled[1:].square() + scaled[:-1].square())[pairs].sum()) / 2
    rho = products / max(power, 1e-300)
    significant = abs(rho) > SIGNIFICANT / math.sqrt(float(pairs.sum()))
    return min(max(rho, 0.0), LARGEST_CORRELATION) if significant else 0.0
