"""Modes of a Gaussian process on scattered nodes."""

from __future__ import annotations

import pytest
import torch

from dashred.physics.grids.mesh import Mesh
from dashred.physics.runs.initial_state_prior import gaussian_process_modes
from dashred.physics.runs.smooth_modes import modes_of_nodes
from tests.physics.grids.test_stencils import scattered


def test_smooth_modes_have_the_covariance() -> None:
    mesh = Mesh(("x", "y"), scattered(200, 2))
    values, modes = modes_of_nodes(mesh, 0.5)
    whole = (modes * values[:, None]).T @ modes
    apart = torch.cdist(torch.from_numpy(mesh.nodes), torch.from_numpy(mesh.nodes))
    torch.testing.assert_close(whole, torch.exp(-(apart**2) / 0.5), atol=1e-6, rtol=0)
    torch.testing.assert_close(modes.square().mean(dim=1), torch.ones(len(modes)).double())
    assert float(values.sum()) == pytest.approx(1.0)
    assert bool((values.diff() <= 0).all())


def test_smooth_modes_of_many_nodes_have_the_covariance() -> None:
    mesh = Mesh(("x", "y"), scattered(1600, 2))
    values, modes = modes_of_nodes(mesh, 0.2)
    assert len(values) < 1000
    few = modes[:, ::40]
    apart = torch.cdist(torch.from_numpy(mesh.nodes[::40]), torch.from_numpy(mesh.nodes[::40]))
    whole = (few * values[:, None]).T @ few
    torch.testing.assert_close(whole, torch.exp(-(apart**2) / 0.08), atol=1e-6, rtol=0)


def test_a_process_of_all_modes_has_unit_variance() -> None:
    mesh = Mesh(("s",), scattered(40, 1))
    modes = gaussian_process_modes(mesh, 0.2, None)
    assert modes.shape[1:] == mesh.shape
    torch.testing.assert_close(modes.square().sum(dim=0), torch.ones(mesh.shape).double())
