"""Columns that are collinear to rounding share their effect; all others are solved exactly."""

from __future__ import annotations

import pytest
import torch

from dashred.inference.fit.least_squares import NormalEquations
from dashred.inference.fit.normal_equations import solve


def test_a_regular_system_is_solved_without_a_ridge() -> None:
    generator = torch.Generator().manual_seed(0)
    columns = torch.randn((3, 20, 4), generator=generator).double()
    matrix, right = columns.mT @ columns, torch.randn((3, 4, 2), generator=generator).double()
    torch.testing.assert_close(
        solve(matrix, right), torch.linalg.solve(matrix, right), rtol=0, atol=0
    )


def test_only_the_singular_systems_of_a_batch_get_a_ridge() -> None:
    alike = torch.full((2, 2), 4.0).double()
    matrix = torch.stack([alike, 2 * torch.eye(2).double()])
    right = torch.tensor([[[8.0], [8.0]], [[2.0], [6.0]]]).double()
    with pytest.raises(RuntimeError, match="singular"):
        torch.linalg.solve(matrix, right)
    found = solve(matrix, right)
    torch.testing.assert_close(found[0], torch.ones((2, 1)).double(), rtol=1e-6, atol=0)
    torch.testing.assert_close(found[1], torch.tensor([[1.0], [3.0]]).double(), rtol=0, atol=0)


@pytest.mark.parametrize("scale", [1.0, 1e-30, 1e30])
def test_a_step_with_nearly_collinear_columns_lowers_the_misfit(
    scale: float,
) -> None:
    """Powers of a field that hardly varies about its mean, of any size."""
    column = torch.linspace(1, 2, 30).double()
    sizes = torch.tensor([1.0, scale, scale], dtype=torch.float64)
    jacobian, precision = column[:, None] * sizes, 1e-20 * sizes**2
    residuals, phi = column.clone(), torch.zeros(3).double()
    normal = NormalEquations(jacobian, precision, phi, residuals)
    rows, free = phi[None], torch.ones((1, 3), dtype=torch.bool)
    [step] = normal.steps(rows, residuals[None], torch.zeros(1).double(), free)
    assert bool(torch.isfinite(step).all())
    left = residuals + jacobian @ step
    assert float(left.norm()) < 1e-3 * float(residuals.norm())
    assert normal.minimum() < 1e-3 * float(residuals.square().sum())
