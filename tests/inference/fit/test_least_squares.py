"""The effective number of parameters of a fit."""

from __future__ import annotations

import pytest
import torch

from dashred.inference.fit.least_squares import NormalEquations


def test_residuals_shrink_by_the_effective_parameters() -> None:
    """50 unknowns are fitted to 60 readings; the prior determines most of them."""
    generator = torch.Generator().manual_seed(0)

    def normal_draws(*shape: int) -> torch.Tensor:
        return torch.randn(shape, generator=generator, dtype=torch.float64)

    jacobian = normal_draws(60, 50) * torch.logspace(0.5, -2, 50, dtype=torch.float64)
    ones, nowhere = torch.ones(50, dtype=torch.float64), torch.zeros(50, dtype=torch.float64)
    squares = []
    for _ in range(2000):
        readings = jacobian @ normal_draws(50) + normal_draws(60)
        normal = NormalEquations(jacobian, ones, nowhere, -readings)
        fitted = normal.solution(range(50))
        squares.append(float((jacobian @ fitted - readings).square().sum()))
    spent = normal.effective_parameters(range(50))
    assert 20 < spent < 40
    assert sum(squares) / 2000 == pytest.approx(60 - spent, rel=0.01)


def test_effective_parameters_count_determined_unknowns_only() -> None:
    jacobian = torch.tensor([[1e6, 0.0, 0.0], [0.0, 1e6, 0.0]], dtype=torch.float64)
    ones, nothing = torch.ones(3, dtype=torch.float64), torch.zeros(2, dtype=torch.float64)
    normal = NormalEquations(jacobian, ones, torch.zeros(3, dtype=torch.float64), nothing)
    assert normal.effective_parameters(range(3)) == pytest.approx(2.0)
    assert normal.effective_parameters([0, 2]) == pytest.approx(1.0)
    assert normal.effective_parameters([2]) == pytest.approx(0.0, abs=1e-12)


def test_effective_parameters_are_bounded_by_the_rank() -> None:
    """As in a chaotic run: 60 unknowns, a J of rank 40 and of any size."""
    generator = torch.Generator().manual_seed(1)
    tall = torch.randn((100, 40), generator=generator, dtype=torch.float64)
    jacobian = tall @ torch.randn((40, 60), generator=generator, dtype=torch.float64)
    ones, nowhere = torch.ones(60, dtype=torch.float64), torch.zeros(60, dtype=torch.float64)
    nothing = torch.zeros(100, dtype=torch.float64)
    for size in (1e2, 1e5, 1e8):
        normal = NormalEquations(size * jacobian, ones, nowhere, nothing)
        assert normal.effective_parameters(range(60)) == pytest.approx(40.0, abs=0.01)
