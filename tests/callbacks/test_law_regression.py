"""The law of an assimilation with dynamics: when the regression sets it, and how often it runs."""

from __future__ import annotations

from collections.abc import Mapping

import pytest
import torch
from lightning import Trainer
from torch import Tensor

from callbacks import LawRegression
from dashred.config import load_config
from dashred.core.mlflow.metric_names import metric_name
from dashred.data.observation_operator import ObservationOperator
from dashred.inference.latent_sindy.latent_sindy import LatentProblem
from dashred.inference.latent_sindy.step_sensitivities import SimulatorSteps
from dashred.models.dynamics.dynamic_assimilation import DynamicAssimilation
from dashred.physics.runs.ensemble import term_scales
from tests import ring
from tests.models.dynamics.test_dynamic_assimilation import data, make, real, shred, system

__all__ = ["data", "real", "shred", "system"]

COEFFICIENT = -0.3
Points = list[tuple[Mapping[str, float], int]]


@pytest.fixture
def module(system, shred, data, real, monkeypatch) -> DynamicAssimilation:
    """An assimilation that has found the real field."""
    found = make(system, shred, data)
    monkeypatch.setattr(found, "fields", lambda windows: real)
    return found


@pytest.fixture
def points() -> Points:
    return []


@pytest.fixture
def callback(system, data, tmp_path, points: Points) -> LawRegression:
    library = ring.library(system)
    problem = LatentProblem(
        system,
        library,
        term_scales(system, library, ring.ensemble(system, 1).states[0], 0.0),
        ObservationOperator(ring.SENSORS[:4], system),
        ring.TIMES,
        data.windows,
        load_config([f"conf={tmp_path}/ring.yaml"], entry="test").latent_sindy,
        0,
    )
    return LawRegression(
        problem, lambda metrics, step: points.append((metrics, step)), lambda *_: None
    )


def law(module: DynamicAssimilation) -> Tensor:
    return module.dynamics.coefficients.detach()


def test_it_sets_the_law_that_the_steps_of_the_field_lack(system, callback, module, points):
    callback.on_train_epoch_end(Trainer(logger=False, accelerator="cpu"), module)
    library = ring.library(system)
    [metrics] = [metrics for metrics, step in points if step == 1]
    assert metrics == {
        metric_name("dynamics", "u", str(library[1])): pytest.approx(COEFFICIENT, rel=0.05)
    }
    assert law(module).nonzero().flatten().tolist() == [1]


@pytest.mark.parametrize(("fits", "kept"), [(False, True), (True, False)])
def test_a_law_that_the_steps_do_not_fit_is_kept(callback, module, fits, kept):
    wrong = torch.zeros_like(module.dynamics.scales)
    wrong[3] = 0.1
    module.dynamics.set_law(wrong)
    module.steps_fit = fits
    callback.on_train_epoch_end(Trainer(logger=False, accelerator="cpu"), module)
    assert torch.allclose(law(module), wrong) == kept


@pytest.mark.parametrize(("settled", "same"), [(True, True), (True, False), (False, True)])
def test_it_ends_the_fit_when_the_law_stays_and_the_steps_fit(callback, module, settled, same):
    trainer = Trainer(logger=False, accelerator="cpu")
    if same:
        callback.on_train_epoch_end(trainer, module)
    module.steps_fit = True
    module.least_error = module._error if settled else 1e-3
    callback.on_train_epoch_end(trainer, module)
    assert trainer.should_stop == (settled and same)


def test_the_same_field_is_simulated_once(callback, module, data, monkeypatch):
    runs: list[int] = []
    forecasts = SimulatorSteps.forecasts

    def counted(*rest):
        runs.append(1)
        return forecasts(*rest)

    monkeypatch.setattr(SimulatorSteps, "forecasts", counted)
    callback.on_train_epoch_end(Trainer(logger=False, accelerator="cpu"), module)
    final, _ = callback.finish(module, (data.windows, data.fitted), 2)
    assert len(runs) == 1
    assert callback.history[-1] == final.coefficients.tolist()
