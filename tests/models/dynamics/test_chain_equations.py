"""The solution of a chain with a border is that of the dense matrix."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch.linalg import LinAlgError  # type: ignore[attr-defined]

from dashred.models.dynamics.chain_equations import ChainEquations


def equations(times: int, modes: int, common: int) -> tuple[ChainEquations, Tensor, Tensor]:
    """Return the normal equations of random residuals, and the dense matrix and gradient."""
    rng = torch.Generator().manual_seed(3)

    def random(*shape: int) -> Tensor:
        return torch.randn(shape, generator=rng, dtype=torch.float64)

    size = times * modes + common
    matrix, gradient = torch.eye(size, dtype=torch.float64), torch.zeros(size, dtype=torch.float64)
    for t in range(times - 1):
        # A residual of two neighbours and of the common unknowns.
        rows = torch.zeros((modes + 2, size), dtype=torch.float64)
        rows[:, t * modes : (t + 2) * modes] = random(modes + 2, 2 * modes)
        rows[:, times * modes :] = random(modes + 2, common)
        matrix += rows.T @ rows
        gradient += rows.T @ random(modes + 2)
    states = matrix[: times * modes, : times * modes].reshape(times, modes, times, modes)
    chain = ChainEquations(
        torch.stack([states[t, :, t] for t in range(times)]),
        torch.stack([states[t + 1, :, t] for t in range(times - 1)]),
        matrix[: times * modes, times * modes :].reshape(times, modes, common),
        matrix[times * modes :, times * modes :],
        gradient[: times * modes].reshape(times, modes),
        gradient[times * modes :],
    )
    return chain, matrix, gradient


@pytest.mark.parametrize(("times", "modes", "common"), [(6, 3, 2), (2, 4, 1), (5, 2, 0)])
@pytest.mark.parametrize("damping", [0.0, 0.7])
def test_it_is_the_dense_solution(times: int, modes: int, common: int, damping: float) -> None:
    chain, matrix, gradient = equations(times, modes, common)
    states, shared = chain.solve(damping)
    damped = matrix + damping * torch.eye(len(matrix), dtype=torch.float64)
    expected = -torch.linalg.solve(damped, gradient)
    torch.testing.assert_close(torch.cat([states.flatten(), shared]), expected)


def test_the_common_unknowns_alone_have_the_schur_complement() -> None:
    chain, matrix, _ = equations(5, 3, 2)
    own, right = chain.eliminated()
    inverse = torch.linalg.inv(matrix)[-2:, -2:]
    torch.testing.assert_close(own, torch.linalg.inv(inverse))
    _, shared = chain.solve(0.0)
    torch.testing.assert_close(torch.linalg.solve(own, right), -shared)


def test_a_matrix_that_is_not_positive_definite_is_refused() -> None:
    chain, _, _ = equations(3, 2, 1)
    with pytest.raises(LinAlgError):
        chain.solve(-100.0)
