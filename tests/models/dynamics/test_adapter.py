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


@torch.no_grad()
def test_it_gives_zero_for_modes_that_it_gets_and_keeps_those_that_it_has():
    adapted = make()
    adapted.adapter[-1].get_parameter("weight").normal_()
    before = adapted(LATENT)
    adapted.resize(8)
    assert torch.equal(adapted(LATENT)[:, :5], before) and not adapted(LATENT)[:, 5:].any()
    target = torch.randn(30, 8, generator=torch.Generator().manual_seed(1))
    adapted.solve(LATENT, target)
    assert float((adapted(LATENT) - target).square().mean()) < float(target.square().mean())
    found = adapted(LATENT)
    adapted.resize(6)
    torch.testing.assert_close(adapted(LATENT), found[:, :6])
