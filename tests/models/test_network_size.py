"""The network grows with the state; what the configuration gives stays."""

from __future__ import annotations

from dashred.models.network_size import LARGE, SMALL, network_size


def test_a_small_state_gets_a_small_network() -> None:
    assert network_size(2) == SMALL
    assert network_size(16) == SMALL
    assert network_size(17) == LARGE
    assert network_size(512) == LARGE


def test_given_sizes_stay() -> None:
    size = network_size(2, latent=8, epochs=3)
    assert (size.latent, size.decoder, size.epochs) == (8, SMALL.decoder, 3)
    assert network_size(512, decoder=[10]).decoder == [10]
