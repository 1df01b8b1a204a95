"""Steps that are divided until they are stable, against exponentials."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.linalg import expm

from dashred.physics.grids.grid_value import Value
from dashred.physics.grids.mesh import Mesh
from dashred.physics.grids.scattered import Scattered
from dashred.physics.runge_kutta import CLASSICAL
from dashred.physics.substeps import Substeps, spectral_radius
from tests.physics.grids.test_stencils import scattered

MESH = Mesh(("x", "y"), scattered(150, 2))
X, Y = MESH.coordinates.values()


def diffusion(state: torch.Tensor, t: float) -> torch.Tensor:
    operators = Scattered(MESH)
    return 0.01 * torch.as_tensor(operators.on_grid(operators.laplacian(Value(state))))


def turning(state: torch.Tensor, t: float) -> torch.Tensor:
    return 7 * torch.stack([-state[:, 1], state[:, 0]], dim=1)


def test_the_radius_of_diffusion_and_of_a_rotation() -> None:
    matrix = 0.01 * MESH.derivatives[()].to_dense()
    exact = float(np.abs(np.linalg.eigvals(matrix)).max())
    found = spectral_radius(diffusion, torch.cos(3 * X)[None, None], 0.0, 0.1)
    assert exact < found < 1.7 * exact
    state = torch.ones((3, 2), dtype=torch.float64)
    state[1] = torch.nan
    assert spectral_radius(turning, state, 0.0, 0.1) == pytest.approx(1.5 * 7, rel=1e-6)
    assert spectral_radius(turning, state[1:2], 0.0, 0.1) == 0.0


def test_stiff_diffusion_is_stable_and_accurate() -> None:
    matrix = 0.01 * MESH.derivatives[()].to_dense()
    state, h = torch.cos(3 * X + Y)[None, None], 0.4
    assert h * spectral_radius(diffusion, state, 0.0, h) > 20
    exact = torch.from_numpy(expm(h * np.asarray(matrix))) @ state[0, 0]
    found = Substeps(CLASSICAL, diffusion)(state, 0.0, h)
    torch.testing.assert_close(found[0, 0], exact, atol=1e-4, rtol=0)


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e9])
def test_a_driven_state_at_rest_is_stable(size: float) -> None:
    """The relaxation u' = 50 (s − u) from rest, with steps of ten times its time constant."""
    rest = torch.zeros((1, 1), dtype=torch.float64)
    found = Substeps(CLASSICAL, lambda state, t: 50 * (size - state))(rest, 0.0, 0.2)
    assert float(found) == pytest.approx(size * (1 - np.exp(-10)), rel=1e-3)


def test_a_step_that_is_stable_is_not_divided() -> None:
    calls = []

    def rate(state: torch.Tensor, t: float) -> torch.Tensor:
        calls.append(t)
        return turning(state, t)

    flow = Substeps(CLASSICAL, rate)
    flow(torch.ones((1, 2), dtype=torch.float64), 0.0, 0.01)
    calls.clear()
    flow(torch.ones((1, 2), dtype=torch.float64), 1.0, 0.01)
    assert calls == [1.0, 1.005, 1.005, 1.01]


def test_order_of_convergence() -> None:
    start = torch.tensor([[1.0, 0.0]], dtype=torch.float64)
    errors = []
    for count in (16, 32):
        flow, state = Substeps(CLASSICAL, turning), start
        for k in range(count):
            state = flow(state, k / count, 1 / count)
        exact = torch.tensor([np.cos(7.0), np.sin(7.0)])
        errors.append(float((state[0] - exact).norm()))
    assert 3.8 < np.log2(errors[0] / errors[1]) < 4.2
