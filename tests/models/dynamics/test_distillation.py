"""Networks are fitted to states that are known."""

from __future__ import annotations

import copy

import pytest
import torch
from torch import nn

from dashred.models.assimilation import LatentTransform
from dashred.models.dynamics.adapter import AdaptedDecoder
from dashred.models.dynamics.distillation import TOLERANCE, distil
from dashred.models.dynamics.whitening import Whitening

SAMPLES, LATENT, MODES = 40, 6, 5
SCALE = torch.linspace(1.0, 0.1, MODES)


@pytest.fixture
def latent() -> torch.Tensor:
    torch.manual_seed(0)
    return torch.randn(SAMPLES, LATENT)


def test_an_adapter_meets_any_states_of_fewer_samples_than_units(latent) -> None:
    frozen, transform = nn.Linear(LATENT, MODES), LatentTransform(LATENT, 16)
    decoder = AdaptedDecoder(frozen, Whitening(latent), 64, MODES)
    before = copy.deepcopy(frozen.state_dict())
    target = torch.randn(SAMPLES, MODES)
    fitted = [*transform.parameters(), *decoder.adapter.parameters()]
    left = distil(transform, decoder, fitted, latent, target, SCALE)
    assert left < TOLERANCE
    torch.testing.assert_close(decoder(transform(latent)), target, rtol=0, atol=2e-2)
    assert all(torch.equal(frozen.state_dict()[name], value) for name, value in before.items())


def test_without_an_adapter_the_transform_comes_as_near_as_the_decoder_allows(latent) -> None:
    frozen, transform = nn.Linear(LATENT, MODES).requires_grad_(False), LatentTransform(LATENT, 64)
    reachable = frozen(latent + 0.3 * torch.tanh(latent))
    left = distil(transform, frozen, list(transform.parameters()), latent, reachable, SCALE)
    assert left < 1e-2
    beside = reachable + torch.randn(SAMPLES, MODES)
    alone = nn.Linear(LATENT, MODES).requires_grad_(False)
    alone.weight.zero_()
    left = distil(transform, alone, list(transform.parameters()), latent, beside, SCALE)
    assert left > 0.5


def test_the_last_layer_is_a_least_squares_fit(latent) -> None:
    decoder = AdaptedDecoder(nn.Linear(LATENT, MODES), Whitening(latent), 3, MODES)
    target = torch.randn(SAMPLES, MODES)
    decoder.solve(latent, target)
    with torch.no_grad():
        hidden = nn.Sequential(*list(decoder.adapter)[:-1])(latent)
        rest = target - decoder(latent)
    # What is left is orthogonal to the hidden units and to the constant.
    assert float((hidden.T @ rest).abs().max()) < 1e-3
    assert float(rest.sum(dim=0).abs().max()) < 1e-3
