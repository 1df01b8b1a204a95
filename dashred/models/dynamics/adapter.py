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
    of the method). A can reach every combination of POD modes, and modes that F does not know.

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
        return torch.add(self._known(latent), self.adapter(latent))

    def resize(self, modes: int) -> None:
        """Let A give another number of coefficients; those that it has had stay.

        Args:
            modes: number of coefficients. F gives zero for those beyond its own.
        """
        old = self.adapter[-1]
        assert isinstance(old, nn.Linear)
        kept = min(modes, old.out_features)
        last = nn.Linear(old.in_features, modes)
        with torch.no_grad():
            for name, values in last.named_parameters():
                values.zero_()
                values[:kept] = old.get_parameter(name)[:kept]
        self.adapter[-1] = last

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
        rest = (target - self._known(latent)).double()
        gram = features.T @ features
        ridge = RIDGE * float(gram.diagonal().mean()) * torch.eye(len(gram), dtype=gram.dtype)
        found = torch.linalg.solve(gram + ridge, features.T @ rest)
        last.weight.copy_(found[:-1].T)
        last.bias.copy_(found[-1])

    def _known(self, latent: Tensor) -> Tensor:
        """Return F(h), and zero for the modes that F does not know."""
        known, last = self.frozen(latent), self.adapter[-1]
        assert isinstance(last, nn.Linear)
        return nn.functional.pad(known, (0, last.out_features - known.shape[-1]))
