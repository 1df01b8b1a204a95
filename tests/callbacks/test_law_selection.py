"""The law of an assimilation with dynamics is chosen about the minimum of each epoch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import pytest
import torch
from lightning import Trainer
from torch import Tensor

from callbacks import LawSelection
from dashred.config import load_config
from dashred.core.budget import OutOfTimeError
from dashred.core.mlflow.metric_names import metric_name
from dashred.data.observation_operator import ObservationOperator
from dashred.inference.latent_sindy.latent_sindy import LatentProblem
from dashred.models.dynamics.dynamic_assimilation import DynamicAssimilation
from dashred.models.dynamics.state_fit import Minimum, StateFit
from dashred.physics.runs.ensemble import term_scales
from datamodules import WholeRecordingDataModule
from tests import ring
from tests.models.dynamics.test_dynamic_assimilation import data, make, real, shred, system
from tests.models.test_assimilation import fitted

__all__ = ["data", "real", "shred", "system"]

COEFFICIENT = -0.3
Points = list[tuple[Mapping[str, float], int]]


@pytest.fixture
def module(system, shred, data) -> DynamicAssimilation:
    """An assimilation after its second epoch, without a law."""
    found = make(system, shred, data)
    fitted(found, WholeRecordingDataModule(data), 2)
    return found


@pytest.fixture
def points() -> Points:
    return []


@pytest.fixture
def callback(system, data, tmp_path, points: Points) -> LawSelection:
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
    return LawSelection(
        problem, [], lambda metrics, step: points.append((metrics, step)), lambda *_: None
    )


def law(module: DynamicAssimilation) -> Tensor:
    return module.dynamics.coefficients.detach()


def ended() -> Trainer:
    return Trainer(logger=False, accelerator="cpu")


def test_it_sets_the_law_that_the_steps_of_the_field_lack(system, callback, module, points):
    callback.on_train_epoch_end(ended(), module)
    library = ring.library(system)
    [metrics] = [metrics for metrics, step in points if step == 1]
    assert metrics == {
        metric_name("dynamics", "u", str(library[1])): pytest.approx(COEFFICIENT, rel=0.2)
    }
    assert law(module).nonzero().flatten().tolist() == [1]


def test_the_first_epoch_has_no_minimum_and_no_law(system, shred, data, callback):
    module = make(system, shred, data)
    fitted(module, WholeRecordingDataModule(data), 1)
    callback.on_train_epoch_end(ended(), module)
    assert not law(module).any()


def test_without_time_the_law_stays(callback, module, monkeypatch):
    wrong = torch.zeros_like(module.dynamics.scales)
    wrong[3] = 0.1
    module.dynamics.set_law(wrong)

    def late(*_) -> None:
        raise OutOfTimeError

    monkeypatch.setattr(StateFit, "law_equations", late)
    callback.on_train_epoch_end(ended(), module)
    torch.testing.assert_close(law(module), wrong)


def test_the_final_law_is_that_of_the_last_minimum(callback, module):
    found, _, minimum = callback.finish(module, 2)
    assert minimum is not None
    assert found.coefficients.tolist() == minimum.fitted.coefficients.tolist()
    assert found.coefficients.nonzero()[0].tolist() == [1]
    assert callback.history == [found.coefficients.tolist()]
    assert not law(module).any()


def test_readings_that_contradict_every_law_decide_nothing(callback, module, monkeypatch):
    parts = module.minimum.fitted.parts | {"train": 9.0}
    left = module.minimum._replace(fitted=module.minimum.fitted._replace(parts=parts))
    monkeypatch.setattr("callbacks.law_selection.simplest_law", lambda _: left)
    proposed, _, minimum = callback.finish(module, 2)
    assert minimum is None
    assert not proposed.coefficients.any()


def test_steps_that_do_not_fit_decide_nothing(callback, module, monkeypatch):
    fit = StateFit.fit

    def off(self, start: Tensor, error: float) -> Minimum:
        found = fit(self, start, error)
        parts = found.fitted.parts | {"step_error": 1.5}
        return found._replace(fitted=found.fitted._replace(parts=parts))

    monkeypatch.setattr(StateFit, "fit", off)
    proposed, _, minimum = callback.finish(module, 2)
    assert minimum is None
    assert not proposed.coefficients.any()


def test_changes_of_parameters_follow_the_terms_of_the_library(system, shred, data, callback):
    """The last of the coefficients belongs to a parameter."""
    known = callback.problem
    fewer = LawSelection(
        replace(known, library=known.library[:-1], scales=known.scales[:-1]),
        ["nu"],
        callback.child,
        callback.parent,
    )
    module = make(system, shred, data)
    fitted(module, WholeRecordingDataModule(data), 1)
    law = torch.zeros_like(module.dynamics.scales)
    law[1], law[-1] = 0.2, -0.5
    module.dynamics.set_law(law)
    found = fewer.finish(module, 1)
    assert found.parameters == {"nu": pytest.approx(-0.5)}
    assert fewer.parameter_history == {"nu": [pytest.approx(-0.5)]}
    assert found.fit.coefficients.nonzero()[0].tolist() == [1]
    assert len(fewer.history[-1]) == len(known.library) - 1
