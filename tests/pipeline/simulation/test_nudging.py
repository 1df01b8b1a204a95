"""A simulator of fields that blows up is corrected towards the readings, and its law is found."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from dashred.config import load_config
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.ensembles import simulate_nudged_ensemble
from dashred.pipeline.simulation.nominal_run import NominalRun, simulate_nominal
from dashred.pipeline.simulation.nudging import is_lost
from dashred.pipeline.simulation.resolution_check import check_discretisation
from tests.pipeline.simulation.conftest import SHORT_RUN
from tests.ring_recording import write_ring_recording

SYSTEM = """
system:
  title: growth with diffusion
  axes: {x: {length: 10, points: 32}}
  fields: {u: amount}
  equations: {u: 0.1*lap(u) + 0.8*u + 0.6*u**2SATURATION}
  start: {u: 0.5 + 0.3*cos(2*pi*x/10)}
  spread: {u: 0.02}
  integrator: {dt: 0.02}
"""
REST = (
    """
recording: {path: recording.csv, sensors: sensors.csv}
splits: {sensors: {validate: 1, test: 1, extra: 0}}
simulation: {members: 16, held_out: 4, terms: 1}"""
    + SHORT_RUN
)
TIMES = torch.linspace(0, 6, 61, dtype=torch.float64)
SENSORS, NOISE = 8, 0.01


@pytest.fixture(scope="module")
def growth(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The configuration of the simulator without its saturation, beside a recording."""
    folder = tmp_path_factory.mktemp("growth")
    complete = SYSTEM.replace("SATURATION", " - u**3")
    write_ring_recording(folder, complete, (0.51, 0.28), TIMES, SENSORS, NOISE)
    (folder / "growth.yaml").write_text(SYSTEM.replace("SATURATION", "") + REST)
    return folder / "growth.yaml"


@pytest.fixture(scope="module")
def runs(growth: Path) -> tuple[Problem, NominalRun]:
    problem = build_problem(load_config([f"conf={growth}"], entry="test"))
    return problem, simulate_nominal(problem, {})


def test_the_corrected_run_stays_near_the_readings(runs: tuple[Problem, NominalRun]) -> None:
    problem, nominal = runs
    assert is_lost(problem, nominal.states)
    assert not np.isfinite(nominal.states.numpy()).all()
    [reference] = nominal.references
    assert reference.shape == nominal.states.shape
    fit = problem.split.fit
    read = problem.operator(fit)(reference[: len(fit.values)]).numpy()
    assert np.sqrt(np.nanmean(np.square(read - fit.values))) < 5 * NOISE
    assert not is_lost(problem, reference)
    # The corrected simulation is checked again at the end.
    resolution = check_discretisation(problem, nominal, {})
    assert resolution.resolved and resolution.is_early


def test_the_corrected_run_uses_the_fitted_readings_alone(
    runs: tuple[Problem, NominalRun], growth: Path, tmp_path: Path
) -> None:
    problem, nominal = runs
    table = np.loadtxt(growth.parent / "recording.csv", delimiter=",", skiprows=1)
    names = [f"s{i}" for i in range(SENSORS)]
    held_out = [1 + names.index(n) for n in names if n not in problem.split.fit.names]
    table[:, held_out] += 5.0
    table[len(problem.split.fit.times) :, 1:] += 5.0
    header = ",".join(["time", *names])
    path = tmp_path / "changed.csv"
    np.savetxt(path, table, delimiter=",", header=header, comments="")
    changed = build_problem(load_config([f"conf={growth}", f"recording.path={path}"], entry="test"))
    again = simulate_nominal(changed, {})
    torch.testing.assert_close(again.references[0], nominal.references[0])


def test_the_ensemble_is_bounded_and_varied(runs: tuple[Problem, NominalRun]) -> None:
    problem, nominal = runs
    ensemble = simulate_nudged_ensemble(problem, nominal, {})
    assert isinstance(ensemble.states, Tensor)
    assert ensemble.states.shape[:2] == (16, len(problem.split.fit.times))
    states = ensemble.states[:, :]
    assert float(states.abs().max()) < 4.0
    assert float(states.std(dim=0).mean()) > NOISE


def test_the_saturation_is_found(growth: Path, train) -> None:
    ended = train(f"conf={growth}", f"recording.path={growth.parent / 'recording.csv'}")
    assert ended.code == 0, ended.err
    findings = json.loads(ended.read("findings.json"))
    assert findings["verdict"] == "missing-term"
    [term] = findings["terms"]
    assert (term["equation"], term["term"]) == ("u", "u**3")
    low, high = term["ci95"]
    assert low < -1.0 < high and high - low < 0.2
    assert "the run without the law diverges" in ended.out


def test_between_fixed_ends_the_mirror_image_follows(tmp_path: Path) -> None:
    between = SYSTEM.replace("points: 32}", "points: 32, ends: fixed}")
    between = between.replace("0.5 + 0.3*cos(2*pi*x/10)", "0.8*sin(pi*x/10)")
    places = 0.6 + 1.2 * np.arange(SENSORS)
    pulse = np.outer(np.exp(0.1 * TIMES.numpy()), np.sin(np.pi * places / 10))
    names = [f"s{i}" for i in range(SENSORS)]
    header, table = ",".join(["time", *names]), np.column_stack([TIMES.numpy(), pulse])
    np.savetxt(tmp_path / "recording.csv", table, delimiter=",", header=header, comments="")
    rows = [f"{name},u,{place}" for name, place in zip(names, places, strict=True)]
    (tmp_path / "sensors.csv").write_text("\n".join(["name,field,x", *rows]) + "\n")
    (tmp_path / "growth.yaml").write_text(between.replace("SATURATION", "") + REST)
    problem = build_problem(load_config([f"conf={tmp_path / 'growth.yaml'}"], entry="test"))
    grid, [states] = problem.system.grid, simulate_nominal(problem, {}).restarted
    torch.testing.assert_close(grid.ring(grid.own(states)), states)
    assert float(states[:, 0, 0].abs().max()) < 1e-12 and float(states.max()) > 1.2
