"""The network grows with the state; what the configuration gives stays."""

from __future__ import annotations

from itertools import pairwise

from dashred.models.network_size import network_size


def test_a_larger_state_gets_a_network_that_is_no_smaller() -> None:
    sizes = [network_size(values) for values in (2, 16, 17, 1024, 1025, 100_000)]
    for smaller, larger in pairwise(sizes):
        assert smaller.latent <= larger.latent
        assert max(smaller.decoder) <= max(larger.decoder)
        assert smaller.epochs <= larger.epochs
    assert len({(size.latent, tuple(size.decoder)) for size in sizes}) == 3


def test_given_sizes_stay() -> None:
    size = network_size(2, latent=8, epochs=3)
    assert (size.latent, size.decoder, size.epochs) == (8, network_size(2).decoder, 3)
    assert network_size(512, decoder=[10]).decoder == [10]
