"""SHRED: a shallow recurrent decoder from sensor histories to the full field."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dashred.models.pod import POD
from dashred.models.scaler import Scaler

# Buffers of a POD, and a pattern for the weights of a dense layer.
POD_BUFFERS = ("mean", "modes", "scale", "energy")
DENSE_WEIGHTS = r"decoder\.\d+\.weight"


class SHRED(nn.Module):
    """``h_t = G(s_{t-k:t})``, ``û_t = F(h_t)``: LSTM, then a shallow decoder to POD coefficients.

    Williams, Zahn & Kutz, *Sensing with shallow recurrent decoder networks* (2022); decoding to
    POD coefficients as in Bao & Kutz (2025). The outputs of the decoder are in units of each
    coefficient's std, so that all are of order one.

    Args:
        scaler: of the input sensors, fitted on training members.
        pod: basis of the field, fitted on training members.
        spread: standard deviation of each POD coefficient over training members, ``(mode,)``.
        latent: size d of h.
        layers: of the LSTM.
        decoder: widths of the decoder's hidden layers.
    """

    spread: Tensor

    def __init__(
        self,
        scaler: Scaler,
        pod: POD,
        spread: Tensor,
        latent: int,
        layers: int,
        decoder: Sequence[int],
    ) -> None:
        super().__init__()
        self.scaler, self.pod = scaler, pod
        self.register_buffer("spread", spread)
        self.encoder = nn.LSTM(len(scaler.mean), latent, layers, batch_first=True)
        widths = [latent, *decoder]
        hidden = [
            layer
            for before, after in pairwise(widths)
            for layer in (nn.Linear(before, after), nn.GELU())
        ]
        self.decoder = nn.Sequential(*hidden, nn.Linear(widths[-1], len(spread)))

    @classmethod
    def from_weights(cls, weights: Mapping[str, Tensor], grid: tuple[int, ...]) -> SHRED:
        """Return the network with the given weights, which determine all sizes but the grid.

        Args:
            weights: result of ``state_dict()``.
            grid: points along each axis.
        """
        scaler = Scaler(weights["scaler.mean"], weights["scaler.std"])
        mean, modes, scale, energy = (weights[f"pod.{name}"] for name in POD_BUFFERS)
        pod = POD(mean, modes, scale, energy, grid)
        layers = sum(name.startswith("encoder.weight_hh_l") for name in weights)
        latent = weights["encoder.weight_hh_l0"].shape[1]
        widths = [len(w) for name, w in weights.items() if re.fullmatch(DENSE_WEIGHTS, name)]
        shred = cls(scaler, pod, weights["spread"], latent, layers, widths[:-1])
        shred.load_state_dict(weights)
        return shred

    def initialise_from(self, other: SHRED) -> None:
        """Copy the weights of another network, except the last layer, whose POD modes differ."""
        last = f"decoder.{len(self.decoder) - 1}."
        learnt = {
            name: value
            for name, value in other.state_dict().items()
            if name.startswith(("encoder.", "decoder.")) and not name.startswith(last)
        }
        self.load_state_dict(learnt, strict=False)

    def encode(self, windows: Float[Tensor, "batch lag sensor"]) -> Float[Tensor, "batch latent"]:
        """Return h, the last hidden state of the LSTM, for windows in the sensors' own units."""
        return self.encode_sequence(windows)[:, -1]

    def encode_sequence(
        self, sequence: Float[Tensor, "batch time sensor"]
    ) -> Float[Tensor, "batch time latent"]:
        """Return h at every sample of a sequence, computed from all samples up to it."""
        hidden, _ = self.encoder(self.scaler(sequence))
        return hidden

    def coefficients(self, latent: Float[Tensor, "*batch latent"]) -> Float[Tensor, "*batch mode"]:
        """Return the POD coefficients of a latent state."""
        return self.decoder(latent) * self.spread

    def decode(self, latent: Float[Tensor, "batch latent"]) -> Float[Tensor, "batch ..."]:
        """Return the fields ``(batch, field, *grid)`` of a latent state, in physical units."""
        return self.pod.decode(self.coefficients(latent))

    def forward(self, windows: Float[Tensor, "batch lag sensor"]) -> Float[Tensor, "batch ..."]:
        """Return the fields ``(batch, field, *grid)`` of windows."""
        return self.decode(self.encode(windows))


@torch.no_grad()
def reconstruct(
    encode: Callable[[Tensor], Tensor], shred: SHRED, windows: Float[Tensor, "time lag sensor"]
) -> Float[Tensor, "time ..."]:
    """Return the fields ``(time, field, *grid)``, float64, of a recording's windows."""
    return shred.decode(encode(windows)).double()
