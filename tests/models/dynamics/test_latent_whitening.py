"""Whitened latent states."""

from __future__ import annotations

import torch

from dashred.models.dynamics.whitening import LEAST_VARIANCE, Whitening


def test_the_states_have_unit_variance_and_no_correlation():
    generator = torch.Generator().manual_seed(0)
    mixed = torch.randn(200, 4, generator=generator) @ torch.randn(4, 4, generator=generator)
    whitened = Whitening(3.0 + mixed)(3.0 + mixed)
    torch.testing.assert_close(whitened.mean(dim=0), torch.zeros(4), atol=1e-4, rtol=0)
    covariance = torch.cov(whitened.T, correction=0)
    torch.testing.assert_close(covariance, torch.eye(4), atol=1e-3, rtol=0)


def test_a_direction_without_variance_is_not_amplified_without_bound():
    states = torch.zeros(50, 2)
    states[:, 0] = torch.linspace(-1, 1, 50)
    whitening = Whitening(states)
    largest = float(whitening.matrix.abs().max())
    bound = float(states[:, 0].std(correction=0)) * LEAST_VARIANCE**0.5
    assert largest <= 1.01 / bound
    assert Whitening(torch.ones(5, 3)).matrix.isfinite().all()
