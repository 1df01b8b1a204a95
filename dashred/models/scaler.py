"""Standardising the channels of a network's inputs and outputs."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn


class Scaler(nn.Module):
    """(x - mean) / std for each channel; its buffers travel with the network's checkpoint."""

    mean: Tensor
    std: Tensor

    def __init__(self, mean: Float[Tensor, " channel"], std: Float[Tensor, " channel"]) -> None:
        """Keep the given scales."""
        super().__init__()
        self.register_buffer("mean", mean)
        self.register_buffer("std", std)

    @classmethod
    def fit(cls, x: Float[Tensor, "*sample channel"]) -> Scaler:
        """Measure the scales of training members (and of nothing else); NaN are left out.

        A channel that does not vary, or has no value, keeps its unit: std 1.
        """
        channels = x.reshape(-1, x.shape[-1])
        mean = channels.nanmean(dim=0).nan_to_num(nan=0.0)
        std = (channels - mean).square().nanmean(dim=0).sqrt().nan_to_num(nan=0.0)
        # A constant channel's std is not exactly zero, but the rounding error of its mean.
        varies = std > 1e-12 * mean.abs()
        return cls(mean, torch.where(varies, std, torch.ones_like(std)))

    def forward(self, x: Float[Tensor, "*sample channel"]) -> Float[Tensor, "*sample channel"]:
        """Standardise, in the dtype of ``x``."""
        return (x - self.mean.to(x.dtype)) / self.std.to(x.dtype)

    def inverse(self, z: Float[Tensor, "*sample channel"]) -> Float[Tensor, "*sample channel"]:
        """Undo ``forward``."""
        return z * self.std.to(z.dtype) + self.mean.to(z.dtype)
