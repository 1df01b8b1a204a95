"""The size of a start is compared with that of its prior, for the number of modes and fields."""

from __future__ import annotations

import math

import pytest
import torch
from scipy.stats import chi2, norm

from dashred.inference.hypotheses.sensors.chance_of_start import chance_of_start
from dashred.inference.initial_state.start_models import LinearStart


def model(modes: torch.Tensor) -> LinearStart:
    return LinearStart(torch.ones_like(modes[0]), modes)


@pytest.mark.parametrize("z", [0.5, 2.5, 4.0])
def test_one_number_is_a_normal_variable(z: float) -> None:
    start = model(torch.tensor([[3.0]], dtype=torch.float64))
    chance = chance_of_start(start, torch.tensor([z], dtype=torch.float64), 1)
    assert chance == pytest.approx(2 * norm.sf(z), rel=1e-6)


def test_two_and_a_half_spreads_in_one_of_six_fields_are_chance() -> None:
    z = torch.zeros(6, dtype=torch.float64)
    z[2] = 2.5
    chance = chance_of_start(model(torch.eye(6, dtype=torch.float64)), z, 1)
    assert chance == pytest.approx(1 - (1 - 2 * norm.sf(2.5)) ** 6, rel=1e-6)
    assert chance > 0.05


def test_a_field_of_equal_modes_is_a_chi_square() -> None:
    x = 2 * math.pi * torch.arange(16, dtype=torch.float64) / 16
    waves = torch.stack([torch.cos(x), torch.sin(x), torch.cos(2 * x), torch.sin(2 * x)])
    z = torch.tensor([2.0, -1.0, 0.5, 3.0], dtype=torch.float64)
    chance = chance_of_start(model(0.7 * waves[:, None]), z, 16)
    assert chance == pytest.approx(chi2.sf(float(z.square().sum()), 4), rel=1e-6)


def test_a_rare_mode_of_the_size_of_the_spread_is_no_other_start() -> None:
    x = 2 * math.pi * torch.arange(16, dtype=torch.float64) / 16
    waves = torch.stack([torch.cos(x), torch.sin(x), 0.1 * torch.cos(4 * x)])
    spread = math.sqrt(float(waves.square().mean(dim=1).sum()))
    z = torch.tensor([0.0, 0.0, spread / (0.1 * math.sqrt(0.5))], dtype=torch.float64)
    assert z[2] > 10
    assert chance_of_start(model(waves[:, None]), z, 16) > 0.2
