"""A fixed linear map after which the latent states of a recording are uncorrelated."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

# Directions with less variance than this share of the largest are not amplified further.
LEAST_VARIANCE = 1e-4


class Whitening(nn.Module):
    """``W (h − mean)``, with unit variance in each principal direction of given states.

    The latent states of a recording lie in a small part of the latent space. A network that reads
    them as they are sees nearly constant inputs, and its fit is badly conditioned.

    Args:
        states: latent states, ``(time, latent)``.
    """

    mean: Tensor
    matrix: Tensor

    def __init__(self, states: Float[Tensor, "time latent"]) -> None:
        super().__init__()
        states = states.double()
        mean = states.mean(dim=0)
        variances, directions = torch.linalg.eigh(torch.cov(states.T, correction=0))
        largest = float(variances[-1])
        # States that are all equal are not amplified.
        floor = LEAST_VARIANCE * largest if largest > 0 else 1.0
        self.register_buffer("mean", mean.float())
        self.register_buffer("matrix", (directions / variances.clamp(min=floor).sqrt()).float())

    def forward(self, states: Float[Tensor, "*batch latent"]) -> Float[Tensor, "*batch latent"]:
        """Return the whitened states."""
        return (states - self.mean) @ self.matrix
