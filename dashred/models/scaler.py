"""Standardisation of the channels of a network's inputs."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn


class Scaler(nn.Module):
    """``(x - mean) / std`` for each channel; the buffers are part of the network's checkpoint."""

    mean: Tensor
    std: Tensor

    def __init__(self, mean: Float[Tensor, " channel"], std: Float[Tensor, " channel"]) -> None:
        """Store the given mean and std."""
        super().__init__()
        self.register_buffer("mean", mean)
        self.register_buffer("std", std)

    @classmethod
    def fit(cls, x: Float[Tensor, "*sample channel"]) -> Scaler:
        """Compute mean and std of training data, ignoring NaN.

        A channel that is constant or has no values gets std 1.
        """
        channels = x.reshape(-1, x.shape[-1])
        mean = channels.nanmean(dim=0).nan_to_num(nan=0.0)
        std = (channels - mean).square().nanmean(dim=0).sqrt().nan_to_num(nan=0.0)
        # The std of a constant channel is not exactly zero but a rounding error of its mean.
        varies = std > 1e-12 * mean.abs()
        return cls(mean, torch.where(varies, std, torch.ones_like(std)))

    def forward(self, x: Float[Tensor, "*sample channel"]) -> Float[Tensor, "*sample channel"]:
        """Standardise, in the dtype of ``x``."""
        return (x - self.mean.to(x.dtype)) / self.std.to(x.dtype)

    def inverse(self, z: Float[Tensor, "*sample channel"]) -> Float[Tensor, "*sample channel"]:
        """Undo ``forward``."""
        return z * self.std.to(z.dtype) + self.mean.to(z.dtype)
