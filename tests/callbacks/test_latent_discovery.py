"""Latent SINDy as a callback: its epochs, and the logged coefficients."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from lightning import Trainer

from callbacks import LatentDiscovery
from dashred.config import load_config
from dashred.core.mlflow.metric_names import metric_name
from dashred.core.mlflow.tracker import Tracker
from dashred.data.observation_operator import ObservationOperator
from dashred.inference.latent_sindy.latent_sindy import LatentProblem
from dashred.models.assimilation import Assimilation, AssimilationSensors
from dashred.physics.runs.ensemble import term_scales
from dashred.physics.solvers.simulate import simulate
from datamodules import RecordingDataModule
from tests import ring

LAGS = 6


@pytest.fixture
def setting(tmp_path):
    """A module, its data and a latent SINDy problem, for a field that decays faster."""
    system = ring.linear_system(tmp_path)
    library = ring.library(system)
    lawful = system.with_terms([(library[ring.LIBRARY.index("u")], -0.3)])
    real = simulate(lawful, ring.starts(system, 1, 7), ring.TIMES)[0]
    names = tuple(sensor.name for sensor in ring.SENSORS[:5])
    recording = ring.record(system, real)
    data = RecordingDataModule(
        recording.select(names), recording.select(["s5"]), names, LAGS, 16, 0
    )
    operator = ObservationOperator(ring.SENSORS[:5], system)
    states = ring.ensemble(system, 8).states
    module = Assimilation(
        ring.untrained(states, operator).float(),
        AssimilationSensors(
            operator,
            ObservationOperator(ring.SENSORS[5:], system),
            torch.full((5,), 0.1),
            torch.ones(5),
            torch.ones(1),
        ),
        width=8,
        penalty=0.01,
        rate=1e-2,
        encoder_rate=0.0,
    )
    settings = load_config([f"conf={tmp_path}/ring.yaml"], entry="test").latent_sindy
    scales = term_scales(system, library, states[0], 0.0)
    problem = LatentProblem(
        system, library, scales, operator, ring.TIMES, data.windows, settings, 0
    )
    return module, data, problem


def fitted(module, data, callback, epochs):
    trainer = Trainer(
        accelerator="cpu",
        max_epochs=epochs,
        num_sanity_val_steps=0,
        callbacks=[callback],
        logger=False,
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
    )
    trainer.fit(module, data)


def test_coefficients_reach_the_store_by_epoch(setting, tmp_path):
    module, data, problem = setting
    problem = replace(problem, settings=replace(problem.settings, every=2))
    with Tracker.open(str(tmp_path / "mlruns"), "ring", "run") as parent:
        with parent.child("assimilate") as child:
            callback = LatentDiscovery(problem, child.log_metrics, parent.log_metrics)
            fitted(module, data, callback, 4)
            final = callback.finish(module)
        client = parent._store.client
        assert callback.epochs == [2, 4, 5]  # the last is the final state
        for name in ("alg1", "alg2"):
            history = np.array(callback.history[name])
            assert history.shape == (3, len(problem.library))
            assert history[-1].tolist() == final[name].coefficients.tolist()
            assert np.isfinite(history).all()
            for j, term in enumerate(problem.library):
                key = metric_name(name, term.equation, str(term))
                points = client.get_metric_history(child.run_id, key)
                logged = {point.step: point.value for point in points}
                expected = dict(zip([2, 4, 5], history[:, j].tolist(), strict=True))
                first = next((step for step, v in expected.items() if v), None)
                if first is None:
                    assert logged == {}
                else:
                    assert logged == {s: v for s, v in expected.items() if s >= first}
                headline = client.get_metric_history(parent.run_id, key)
                assert {point.step for point in headline} == ({5} if first else set())


def deaf(metrics, step):
    """Ignore the metrics."""


def test_latent_sindy_leaves_the_training_as_it_is(setting):
    """Neither its copy in float64 nor its random draws change the module."""
    module, _, problem = setting
    before = {name: value.clone() for name, value in module.state_dict().items()}
    callback = LatentDiscovery(problem, deaf, deaf)
    drawn = torch.get_rng_state()
    first = callback.finish(module)
    assert torch.equal(torch.get_rng_state(), drawn)
    assert all(torch.equal(value, before[name]) for name, value in module.state_dict().items())
    assert next(module.encoder.transform.parameters()).requires_grad
    again = callback.finish(module)
    np.testing.assert_array_equal(first["alg1"].coefficients, again["alg1"].coefficients)
    assert callback.final is again
