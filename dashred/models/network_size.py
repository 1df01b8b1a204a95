"""The size of SHRED and the length of its training, chosen by the size of the state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

# A state with at most this many values needs a small network.
SMALL_STATE = 16


@dataclass(frozen=True)
class NetworkSize:
    """What a configuration may leave open.

    Attributes:
        latent: size of the latent state.
        decoder: widths of the hidden layers of the decoder.
        epochs: maximum number of epochs.
    """

    latent: int
    decoder: Sequence[int]
    epochs: int


# Measured on oscillators: the large one lowers the error on unseen simulations by less than a tenth
# of it, and takes ten times as long.
SMALL = NetworkSize(32, (64, 64), 14)
LARGE = NetworkSize(64, (256, 256), 44)


def network_size(
    values: int,
    latent: int | None = None,
    decoder: Sequence[int] | None = None,
    epochs: int | None = None,
) -> NetworkSize:
    """Return the size for a state, with the parts that are given.

    Args:
        values: number of values of the state: fields times points of the grid.
        latent: size of the latent state; None chooses it.
        decoder: widths of the hidden layers; None chooses them.
        epochs: maximum number of epochs; None chooses it.
    """
    chosen = SMALL if values <= SMALL_STATE else LARGE
    return NetworkSize(
        chosen.latent if latent is None else latent,
        chosen.decoder if decoder is None else decoder,
        chosen.epochs if epochs is None else epochs,
    )
