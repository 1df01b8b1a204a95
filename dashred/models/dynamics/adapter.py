"""An adapter beside the frozen decoder, for fields that lie outside of its range."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dashred.models.dynamics.whitening import Whitening

# Ridge of the last layer, as a share of the mean square of a hidden unit.
RIDGE = 1e-8


class AdaptedDecoder(nn.Module):
    """``F(h) + A(h)``: the frozen decoder F, and a small network A initialised to zero.

    F has learnt the fields of a simulator. A real field may have coefficients that F gives for no
    latent state, although the POD basis contains it (Bao & Kutz 2025, §6, name the basis as a limit
    of the method). A can reach every combination of POD modes.

    Args:
        frozen: F, from latent states to POD coefficients in units of their std.
        whitening: of the latent states that A reads.
        width: hidden units of A.
        modes: number of POD coefficients.
    """

    def __init__(self, frozen: nn.Module, whitening: Whitening, width: int, modes: int) -> None:
        super().__init__()
        last = nn.Linear(width, modes)
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        self.frozen = frozen
        first = nn.Linear(len(whitening.mean), width)
        self.adapter = nn.Sequential(whitening, first, nn.Tanh(), last)

    def forward(self, latent: Float[Tensor, "*batch latent"]) -> Float[Tensor, "*batch mode"]:
        """Return ``F(h) + A(h)``."""
        return torch.add(self.frozen(latent), self.adapter(latent))

    @torch.no_grad()
    def solve(
        self, latent: Float[Tensor, "batch latent"], target: Float[Tensor, "batch mode"]
    ) -> None:
        """Set the last layer of A so that ``F(h) + A(h)`` comes nearest to a target.

        A ridge keeps the weights small where few samples leave them free.
        """
        *hidden, last = self.adapter
        assert isinstance(last, nn.Linear)
        features = nn.Sequential(*hidden)(latent).double()
        features = torch.cat([features, torch.ones_like(features[:, :1])], dim=1)
        rest = (target - self.frozen(latent)).double()
        gram = features.T @ features
        ridge = RIDGE * float(gram.diagonal().mean()) * torch.eye(len(gram), dtype=gram.dtype)
        found = torch.linalg.solve(gram + ridge, features.T @ rest)
        last.weight.copy_(found[:-1].T)
        last.bias.copy_(found[-1])
