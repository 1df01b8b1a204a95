"""The noise model of the sensors: standard deviation and lag-one correlation."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

# A correlation below this many standard errors is set to zero.
SIGNIFICANT = 3.0
LARGEST_CORRELATION = 0.99
# Residuals below this share of the σ before any fit say nothing. That σ is a hundredth of a trace
# or more, so this is the step of a 16-bit converter. The rounding and integration errors of
# whatever made readings without noise would otherwise prove terms of their own size.
LEAST_NOISE = 1e-3
# Residuals whose mean square is larger, in units of σ², are those of a run that blows up. A stated
# σ may be too small by many orders of magnitude.
LARGEST_SQUARE = 1e24


@dataclass(frozen=True)
class NoiseModel:
    """First-order autoregressive noise: ``e_t = ρ e_{t-1} + √(1-ρ²) σ η_t``, η ~ N(0, 1).

    Attributes:
        std: σ of each sensor, ``(sensor,)``, in the unit of the sensor.
        correlation: ρ of each sensor between neighbouring samples, ``(sensor,)``.
        available: whether a sample is available, ``(time, sensor)``; the sequence restarts after
            a gap.
        relative: σ of every sample as a factor of its sensor's σ, ``(time, sensor)``; None for 1.
        at_stop: which samples are at the stop of a sensor, and say nothing of its noise,
            ``(time, sensor)``; None without any.
        least_std: σ that no estimate undercuts, ``(sensor,)``.
    """

    std: Tensor
    correlation: Tensor
    available: Tensor
    relative: Tensor | None = None
    at_stop: Tensor | None = None
    least_std: Tensor | None = None

    @property
    def count(self) -> int:
        """Number of available samples that are not at a stop."""
        return int(self._noisy.sum())

    @property
    def effective_count(self) -> float:
        """Effective number of independent samples: ``Σ n (1-ρ)/(1+ρ)`` over the sensors."""
        shares = (1 - self.correlation) / (1 + self.correlation)
        return float(self._noisy.sum(dim=0).double() @ shares)

    def truncate(self, samples: int) -> NoiseModel:
        """Return the model of the first samples."""
        return self.part(slice(samples))

    def part(self, samples: slice) -> NoiseModel:
        """Return the model of some samples."""
        relative = None if self.relative is None else self.relative[samples]
        at_stop = None if self.at_stop is None else self.at_stop[samples]
        return replace(self, available=self.available[samples], relative=relative, at_stop=at_stop)

    def whiten(self, values: Float[Tensor, "*batch time sensor"]) -> Tensor:
        """Return values whitened to independent noise of variance 1; missing ones are zero."""
        scaled = torch.where(self.available, values, 0.0) / self.stds
        rho = self.correlation
        if not rho.any():
            return scaled
        follows = (self.available[1:] & self.available[:-1]).to(scaled.dtype)
        rest = scaled[..., 1:, :] - rho * scaled[..., :-1, :] * follows
        rest = rest / (1 - rho**2 * follows).sqrt()
        return torch.cat([scaled[..., :1, :], rest], dim=-2)

    def over(self, samples: NoiseModel) -> NoiseModel:
        """Return the model with the samples of another one of the same sensors."""
        return replace(samples, std=self.std, correlation=self.correlation)

    def scaled(self, factor: float) -> NoiseModel:
        """Return the model with all σ multiplied by a factor."""
        return replace(self, std=self.std * factor)

    def estimate(
        self, residuals: Float[Tensor, "time sensor"], groups: list[str], parameters: float
    ) -> NoiseModel:
        """Return the noise model estimated from the residuals of a fit.

        Sensors are grouped by the quantity that they read. In a group the ratios of σ stay, and
        the residuals set its level. ρ is the pooled lag-one correlation of the group, if it is
        significant. A group without available samples, or with residuals of a fit that blew up,
        keeps its σ, and its ρ is zero.

        Args:
            residuals: readings minus recording.
            groups: the quantity that each sensor reads.
            parameters: effective number of fitted parameters.
        """
        std, correlation = self.std.clone(), torch.zeros_like(self.std)
        left = max(1.0 - parameters / max(1, self.count), 0.1)
        noisy = self._noisy
        squares = torch.where(noisy, residuals / self.stds, 0.0).square()
        resized = residuals if self.relative is None else residuals / self.relative
        for group in dict.fromkeys(groups):
            in_group = torch.tensor([g == group for g in groups])
            if not noisy[:, in_group].any():
                continue
            mean = float(squares[:, in_group].sum() / noisy[:, in_group].sum())
            # Written with "<", because the residuals may be NaN.
            if not mean < LARGEST_SQUARE:
                continue
            std[in_group] *= max(math.sqrt(mean / left), 1e-12)
            if self.least_std is not None:
                std[in_group] = torch.maximum(std[in_group], self.least_std[in_group])
            scaled = resized[:, in_group] / std[in_group]
            correlation[in_group] = _lag_one(scaled, noisy[:, in_group])
        return replace(self, std=std, correlation=correlation)

    @property
    def _noisy(self) -> Tensor:
        return self.available if self.at_stop is None else self.available & ~self.at_stop

    @property
    def stds(self) -> Tensor:
        """σ of every sample, ``(time, sensor)`` or ``(sensor,)``."""
        return self.std if self.relative is None else self.std * self.relative


def _lag_one(scaled: Float[Tensor, "time sensor"], available: Tensor) -> float:
    """Return the lag-one correlation; 0 if it is negative or not significant."""
    pairs = available[1:] & available[:-1]
    if not pairs.any():
        return 0.0
    products = float((scaled[1:] * scaled[:-1])[pairs].sum())
    power = float((scaled[1:].square() + scaled[:-1].square())[pairs].sum()) / 2
    rho = products / max(power, 1e-300)
    significant = abs(rho) > SIGNIFICANT / math.sqrt(float(pairs.sum()))
    return min(max(rho, 0.0), LARGEST_CORRELATION) if significant else 0.0
