"""Further unknowns and fewer samples of a linearised fit, against fits of the whole problem."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from dashred.inference.sensor_faults.linearised_fit import Columns, LinearisedFit

SAMPLES, UNKNOWNS, FURTHER = 40, 12, 3
OWN = torch.zeros(SAMPLES, dtype=torch.bool)
OWN[::5] = True
SCALES = torch.tensor([0.1, 1.0, 10.0], dtype=torch.float64)


def draw(*shape: int, seed: int) -> Tensor:
    return torch.randn(shape, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))


@pytest.fixture
def fit() -> LinearisedFit:
    precision = torch.linspace(0.1, 5, UNKNOWNS, dtype=torch.float64)
    return LinearisedFit(draw(SAMPLES, UNKNOWNS, seed=0), draw(SAMPLES, seed=1), precision)


@pytest.fixture
def columns() -> Columns:
    matrix = draw(SAMPLES, FURTHER, seed=2) * OWN[:, None]
    return Columns.of(matrix, draw(SAMPLES, seed=3) * OWN)


def minimum(fit: LinearisedFit) -> tuple[float, Tensor]:
    """Return the minimum of F and its unknowns by least squares."""
    rows = torch.cat([fit.jacobian, torch.diag(fit.precision.sqrt())])
    target = torch.cat([fit.target, torch.zeros_like(fit.precision)])
    phi = torch.linalg.lstsq(rows, target[:, None]).solution[:, 0]
    return float((rows @ phi - target).square().sum()), phi


def test_columns_keep_the_rows_that_are_not_zero(columns: Columns) -> None:
    assert torch.equal(columns.rows, torch.nonzero(OWN).flatten())
    assert columns.matrix.shape == (int(OWN.sum()), FURTHER)


def test_the_profile_over_further_unknowns(fit: LinearisedFit, columns: Columns) -> None:
    cost, phi = minimum(fit.with_columns(columns, SCALES))
    found = fit.profile(columns).minimum(SCALES)
    assert found.cost == pytest.approx(cost, rel=1e-10)
    assert torch.allclose(found.parameters, phi[-FURTHER:], rtol=1e-9)


def test_the_fit_without_some_samples(fit: LinearisedFit) -> None:
    without = fit.without_rows(OWN)
    cost, phi = minimum(without)
    assert fit.cost_without(OWN) == pytest.approx(cost, rel=1e-10)
    assert without.cost == pytest.approx(cost, rel=1e-10)
    errors = fit.target - fit.jacobian @ phi
    assert torch.allclose(fit.residual_without(OWN), errors[OWN], rtol=1e-9)
    assert torch.allclose(fit.misfit_without(OWN), errors * ~OWN, atol=1e-10)


def test_no_sample_left_out_changes_nothing(fit: LinearisedFit) -> None:
    none = torch.zeros_like(OWN)
    assert fit.cost_without(none) == fit.cost
    assert torch.equal(fit.misfit_without(none), fit.misfit)
