"""The adapter beside a frozen decoder."""

from __future__ import annotations

import torch
from torch import nn

from dashred.models.dynamics.adapter import AdaptedDecoder
from dashred.models.dynamics.whitening import Whitening

LATENT = torch.randn(30, 3, generator=torch.Generator().manual_seed(0))


def make() -> AdaptedDecoder:
    torch.manual_seed(0)
    frozen = nn.Linear(3, 5).requires_grad_(False)
    return AdaptedDecoder(frozen, Whitening(LATENT), 16, 5)


def test_it_starts_as_the_frozen_decoder():
    adapted = make()
    assert torch.equal(adapted(LATENT), adapted.frozen(LATENT))


def test_it_reaches_coefficients_that_the_decoder_does_not_give():
    adapted = make()
    wanted = adapted.frozen(LATENT) + LATENT[:, :1].square()
    optimizer = torch.optim.LBFGS(adapted.adapter.parameters(), max_iter=200)

    def closure() -> torch.Tensor:
        optimizer.zero_grad()
        loss = (adapted(LATENT) - wanted).square().mean()
        loss.backward()
        return loss

    before = closure().item()
    optimizer.step(closure)
    assert closure().item() < 1e-3 * before
    assert all(p.grad is None for p in adapted.frozen.parameters())
