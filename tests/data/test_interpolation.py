"""The trigonometric interpolant, on small rings and on fine ones with many sensors."""

from __future__ import annotations

import math

import pytest
import torch

from dashred.data.interpolation import trigonometric_weights
from dashred.physics.grids.grid import Axis

PERIOD = 3.7


def ring(points: int) -> Axis:
    return Axis("x", PERIOD, points, "periodic")


@pytest.mark.parametrize("points", [1, 2, 7, 8, 33])
def test_the_weights_are_the_sum_of_cosines(points: int) -> None:
    places = torch.tensor([-5.0, 0.0, 0.1, 1.9, 3.69, 9.2], dtype=torch.float64)
    apart = places[:, None] / PERIOD - torch.arange(points, dtype=torch.float64) / points
    expected = torch.ones_like(apart) / points
    for mode in range(1, points // 2 + 1):
        share = 1.0 if 2 * mode == points else 2.0
        expected += share / points * torch.cos(2 * math.pi * mode * apart)
    found = trigonometric_weights(ring(points), places)
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-12)


def test_many_sensors_on_a_fine_axis_are_exact_and_take_little_memory() -> None:
    # One value for each sensor, point and mode would take 34 GB.
    axis, mode = ring(4096), 1500
    places = PERIOD * torch.rand(512, dtype=torch.float64, generator=torch.manual_seed(0))
    nodes = PERIOD * torch.arange(4096, dtype=torch.float64) / 4096
    field, values = (torch.sin(2 * math.pi * mode * x / PERIOD) for x in (nodes, places))
    found = trigonometric_weights(axis, places) @ field
    torch.testing.assert_close(found, values, rtol=0, atol=1e-9)
