"""Errors of the steps in the fields and in the latent space."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.models.dynamics.network_assimilation import NetworkAssimilation
from dashred.models.dynamics.sampled_dynamics import Samples
from dashred.models.dynamics.step_residuals import (
    AdvancingResidual,
    FieldResidual,
    Histories,
    SearchResidual,
)
from dashred.models.lag_windows import windows
from datamodules import WholeRecordingDataModule
from tests import ring
from tests.models.dynamics.test_dynamic_assimilation import (
    built,
    data,
    field_errors,
    real,
    shred,
    system,
)
from tests.models.test_assimilation import INPUTS, LAGS, fitted

__all__ = ["data", "real", "shred", "system"]


@pytest.fixture
def operator(system) -> ObservationOperator:
    return ObservationOperator(tuple(s for s in ring.SENSORS if s.name in INPUTS), system)


@pytest.fixture
def exact(system, shred, real, operator) -> tuple[Histories, Tensor]:
    """Histories of the real field, and their latent states."""
    known = windows(operator(real), LAGS).float()
    return Histories(shred.encode, known, operator), shred.encode(known)


def block(module: NetworkAssimilation) -> Samples:
    [found] = module.dynamics.blocks()
    return found


def test_the_residual_in_the_fields_is_the_error_of_the_forecast(system, shred, data, real):
    module = built(NetworkAssimilation, system, shred, data)
    forecast = module.dynamics.advance(block(module), real[:-1])
    found = FieldResidual(module.dynamics)(block(module), torch.zeros(0), real, forecast)
    expected = (real[1:] - forecast) / float(shred.pod.scale[0])
    torch.testing.assert_close(found, expected, check_dtype=False)


@torch.no_grad()
def test_latent_residuals_are_zero_where_the_forecast_is_the_field(
    system, shred, data, real, exact
):
    samples = block(built(NetworkAssimilation, system, shred, data))
    known, latent = exact
    for residual in (SearchResidual(known), AdvancingResidual(known, torch.nn.Identity())):
        found = residual(samples, latent, real, real[1:].double())
        assert found.shape == (len(real) - 1, latent.shape[1])
        assert float(found.abs().max()) < 1e-3


@torch.no_grad()
def test_they_are_the_formulas_of_the_algorithms(system, shred, data, real, operator, exact):
    samples = block(built(NetworkAssimilation, system, shred, data))
    known, latent = exact
    forecast, traces = 0.9 * real[1:].double(), operator(real)
    histories = windows(traces, LAGS).float()
    later = histories[1:].clone()
    later[:, -1] = 0.9 * traces[1:]
    expected = (shred.encode(histories[1:]) - shred.encode(later)) / latent.std(dim=0)
    found = SearchResidual(known)(samples, latent, real, forecast)
    torch.testing.assert_close(found, expected, rtol=1e-3, atol=1e-4)

    def transform(states: Tensor) -> Tensor:
        return states + 0.1 * states.square()

    moved = transform(latent)
    step = transform(shred.encode(later)) - transform(shred.encode(histories[:-1]))
    expected = (moved.diff(dim=0) - step) / latent.std(dim=0)
    found = AdvancingResidual(known, transform)(samples, moved, real, forecast)
    torch.testing.assert_close(found, expected, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("algorithm", [1, 2])
def test_a_fit_in_latent_space_brings_the_field_nearer_to_the_real_one(
    system, shred, data, real, operator, algorithm
):
    module = built(NetworkAssimilation, system, shred, data)
    known = Histories(module.shred.encode, data.windows, operator)
    module.residual = (
        SearchResidual(known)
        if algorithm == 1
        else AdvancingResidual(known, module.encoder.transform)
    )
    module.dynamics.set_law(torch.tensor([0, -0.2, 0, 0, 0, 0, 0, 0]).double())
    fitted(module, WholeRecordingDataModule(data), 3)
    before, after = field_errors(shred, module, data, real)
    assert after < 0.6 * before and module.error < 0.1
