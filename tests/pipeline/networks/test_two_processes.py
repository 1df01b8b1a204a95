"""Networks trained in two processes on the CPU: all of the result is in this one."""

from __future__ import annotations

import json
import math
import os
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from dashred.core.budget import Budget
from dashred.core.mlflow.metric_names import metric_name
from dashred.core.mlflow.tracker import Tracker
from dashred.pipeline.networks.assimilation import sensor_data
from dashred.pipeline.networks.training import train_shred
from dashred.pipeline.problem import Problem
from tests.conftest import run_command
from tests.pipeline.networks.conftest import Configured
from tests.pipeline.networks.fits import Networks, fit_networks

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="needs two CPUs"),
]
CURVES = {"rmse/field_members": [0, 1, 2, 3, 4], "loss/train": [1, 2, 3, 4]}
SENSORS = "rmse/sensors_validate"


@pytest.fixture(scope="module")
def one(configured: Configured) -> Networks:
    return fit_networks(configured())


@pytest.fixture(scope="module")
def two(configured: Configured) -> Networks:
    return fit_networks(configured("trainer.devices=2"))


def validation_rmse(problem: Problem, field: torch.Tensor) -> float:
    """Return the RMSE of a field at the validation sensors, in units of each trace's std."""
    validation = problem.split.validation
    innovation = sensor_data(problem).validated - problem.operator(validation)(field)
    scaled = innovation / torch.from_numpy(validation.trace_scale())
    return math.sqrt(float(scaled[~scaled.isnan()].square().mean()))


def test_the_curves_and_the_log_are_here_once(one: Networks, two: Networks) -> None:
    curves = two.shred.curves
    assert {name: [epoch for epoch, _ in curve] for name, curve in curves.items()} == CURVES
    assert [(step, list(point)) for step, point in two.log if "alg" not in str(point)] == [
        (step, list(point)) for step, point in one.log if "alg" not in str(point)
    ]
    # Before training, both have the same network and the same validation data.
    assert curves["rmse/field_members"][0][1] == pytest.approx(
        one.shred.curves["rmse/field_members"][0][1], rel=1e-6
    )


def test_shares_of_a_batch_train_as_the_batch_does(one: Networks, two: Networks) -> None:
    """Only the draws of the sensor noise differ."""
    for name in CURVES:
        for (_, found), (_, expected) in zip(
            two.shred.curves[name], one.shred.curves[name], strict=True
        ):
            assert found == pytest.approx(expected, rel=0.02)
    assert two.shred.test_rmse["all"] == pytest.approx(one.shred.test_rmse["all"], rel=0.02)


def test_the_weights_of_the_best_epoch_are_here(configured: Configured, two: Networks) -> None:
    found = two.assimilated
    epoch, lowest = min(found.curves[SENSORS], key=lambda point: point[1])
    assert found.best_epoch == epoch > 0
    assert validation_rmse(configured().problem, found.dashred) == pytest.approx(lowest, rel=1e-5)


def test_the_history_of_latent_sindy_is_here(configured: Configured, two: Networks) -> None:
    found = two.assimilated
    assert found.epochs == [1, 2, 3, 4, 5]
    logged = {(step, key): value for step, point in two.log for key, value in point.items()}
    nonzero = 0
    for name, fit in found.proposals.items():
        assert len(found.coefficients[name]) == 5
        assert found.coefficients[name][-1] == fit.coefficients.tolist()
        for epoch, row in zip(found.epochs, found.coefficients[name], strict=True):
            for term, value in zip(configured().problem.library, row, strict=True):
                if value != 0:
                    nonzero += 1
                    assert logged[epoch, metric_name(name, term.equation, str(term))] == value
    assert nonzero > 0  # most coefficients of so short a training are zero


def test_the_same_seed_gives_the_same_result(configured: Configured, two: Networks) -> None:
    again = fit_networks(configured("trainer.devices=2"))
    weights = two.shred.shred.state_dict()
    for name, value in again.shred.shred.state_dict().items():
        assert torch.equal(value, weights[name])
    assert torch.equal(again.assimilated.dashred, two.assimilated.dashred)
    assert again.assimilated.coefficients == two.assimilated.coefficients
    assert again.log == two.log


def test_a_fit_that_is_ended_early_reaches_the_store_of_mlflow(
    configured: Configured, tmp_path: Path
) -> None:
    simulated = configured("trainer.devices=2")
    spent = replace(simulated.problem, budget=Budget.begin(1e-9))
    assert simulated.ensemble is not None
    with Tracker.open(str(tmp_path / "mlruns"), "networks", "run") as run:
        train_shred(spent, simulated.ensemble, run, {}, "SHRED")
        points = run._store.client.get_metric_history(run.run_id, "shred/rmse/field_members")
    assert sorted(point.step for point in points) == [0, 1]
    assert spent.budget.not_tried == ["epochs 2 to 4 of SHRED"]


def test_an_analysis_runs_once_and_its_networks_in_two_processes(
    quick: Path, tmp_path: Path
) -> None:
    ended = run_command(tmp_path, f"conf={quick}", "trainer.devices=2")
    assert ended.code == 0, ended.err
    assert ended.out.count("train SHRED ") == ended.out.count("assimilate, latent SINDy") == 1
    assert "distributed" not in ended.out + ended.err
    assert json.loads(ended.read("findings.json"))["verdict"]
