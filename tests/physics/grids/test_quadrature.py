"""Integrals over axes with ends are exact, whatever a field is beyond its ends."""

from __future__ import annotations

import math

import pytest
import torch

from dashred.physics.grids.grid import Axis, Grid
from dashred.physics.grids.quadrature import integral

L = 3.0


@pytest.mark.parametrize("ends", ["fixed", "insulated"])
@pytest.mark.parametrize(
    ("wave", "n", "exact"),
    [
        (torch.sin, 1, 2 * L / math.pi),
        (torch.sin, 2, 0.0),
        (torch.sin, 5, 2 * L / (5 * math.pi)),
        (torch.cos, 0, L),
        (torch.cos, 3, 0.0),
    ],
)
def test_a_wave_on_an_axis_with_ends(ends: str, wave, n: int, exact: float) -> None:
    grid = Grid((Axis("x", L, 16, ends),))
    x = torch.arange(32, dtype=torch.float64) * L / 16
    assert float(integral(grid, wave(n * math.pi * x / L))) == pytest.approx(exact, abs=1e-12)


def test_a_plane_is_integrated_along_both_axes() -> None:
    grid = Grid((Axis("x", L, 16, "fixed"), Axis("y", 2.0, 8)))
    x = grid.coordinates["x"]
    around = torch.arange(32, dtype=torch.float64).reshape(-1, 1) * L / 16
    y = grid.coordinates["y"]
    assert x.shape == (32, 1)
    field = torch.sin(math.pi * around / L) * (1 + torch.cos(math.pi * y))
    found = integral(grid, torch.stack([field, 2 * field]))
    exact = torch.tensor([2 * L / math.pi * 2.0, 4 * L / math.pi * 2.0], dtype=torch.float64)
    torch.testing.assert_close(found, exact, rtol=0, atol=1e-12)


def test_an_ordinary_system_has_nothing_to_integrate() -> None:
    values = torch.tensor([1.0, 2.0], dtype=torch.float64)
    assert torch.equal(integral(Grid(()), values), values)
