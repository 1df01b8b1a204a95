"""The corrected simulator is the model as told: with the start or the sensor that was corrected."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import torch

from dashred.config import load_config
from dashred.inference.fit.law import Law, SensorFault
from dashred.physics.runs.initial_state_prior import StartPrior, field_rms
from dashred.physics.solvers.simulate import simulate
from dashred.pipeline.analysis import Analysis
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import NominalRun
from dashred.pipeline.trajectories import simulate_trajectories
from dashred.pipeline.verification.comparison import compare_held_out
from dashred.pipeline.verification.held_out import held_out_errors, predict_held_out
from tests import laws

TEXT = """
system:
  title: a swing
  fields: {x: place, p: momentum}
  parameters: {k: 4.0}
  equations: {x: p, p: -k*x}
  start: {x: 1, p: 0}
  spread: {x: 0.1, p: 0.1}
  integrator: {method: rk4, dt: 0.02}
splits: {sensors: {test: [x3], validate: [p2]}}
"""
TIMES, SIGMA = 0.05 * np.arange(201), 0.01
FAR, NEAR = (1.8, -0.9), (1.1, -0.05)
SENSORS = {"x1": 0, "x2": 0, "x3": 0, "p1": 1, "p2": 1}


def swing(start: tuple[float, float], times: np.ndarray = TIMES) -> np.ndarray:
    """Return the exact place and momentum, ``(time, 2)``."""
    x, p = start
    cos, sin = np.cos(2 * times), np.sin(2 * times)
    return np.stack([x * cos + p / 2 * sin, p * cos - 2 * x * sin], axis=1)


def make_problem(folder: Path, start: tuple[float, float], **errors: np.ndarray) -> Problem:
    """Return a recording of the swing; some sensors may have errors."""
    rng = np.random.default_rng(0)
    columns = [TIMES]
    for name, field in SENSORS.items():
        read = swing(start)[:, field] + SIGMA * rng.standard_normal(len(TIMES))
        columns.append(read + errors.get(name, 0.0))
    header = ",".join(["time", *SENSORS])
    np.savetxt(folder / "r.csv", np.column_stack(columns), "%.9g", ",", header=header, comments="")
    table = "\n".join(f"{name},{'xp'[field]}" for name, field in SENSORS.items())
    (folder / "sensors.csv").write_text(f"name,field\n{table}\n")
    (folder / "swing.yaml").write_text(TEXT)
    words = [f"conf={folder}/swing.yaml", f"recording.path={folder}/r.csv"]
    return build_problem(
        load_config([*words, f"recording.sensors={folder}/sensors.csv"], entry="train")
    )


def analysis_of(problem: Problem, best: Law, uncorrected: Law) -> Analysis:
    """Return an analysis with only the parts that verification reads."""
    start = torch.tensor([[1.0, 0.0]], dtype=torch.float64)
    [states] = simulate(problem.system, start, problem.times)
    prior = StartPrior(problem.system, start[0], field_rms(states), None)
    nominal = NominalRun(prior, states)
    discovered = laws.discovery(best, uncorrected=uncorrected)
    runs = simulate_trajectories(problem, nominal, discovered, {})
    assimilated: Any = SimpleNamespace(others=(), shred=states, dashred=states)
    nothing: Any = None
    return Analysis(nominal, nothing, assimilated, discovered, runs, nothing, states)


def from_start(law: Law, start: tuple[float, float]) -> Law:
    return replace(law, start=torch.tensor([start], dtype=torch.float64))


def errors_of(problem: Problem, best: Law, uncorrected: Law) -> dict[str, Any]:
    predictions = predict_held_out(problem, analysis_of(problem, best, uncorrected))
    return cast(dict[str, Any], held_out_errors(predictions))


def test_another_start_lowers_the_error_at_test_sensors_and_in_held_out_time(
    tmp_path: Path,
) -> None:
    problem = make_problem(tmp_path, FAR)
    best, refit = from_start(laws.law(widened=6.4), FAR), from_start(laws.law(), NEAR)
    found = errors_of(problem, best, refit)
    for data in ("test_sensors", "heldout_time"):
        errors = found[data]
        assert errors["corrected"] < 0.05
        assert errors["simulation_refit"] > 5 * errors["corrected"]
        # The start is the correction, so the simulation without it has the nominal start.
        assert errors["simulation_same_start"] == errors["simulation"]
        assert errors["before"] > 5 * errors["after"]


def test_a_law_is_compared_from_its_own_start(tmp_path: Path) -> None:
    problem = make_problem(tmp_path, FAR)
    damping = laws.term(problem.system, "p", "p")
    best = from_start(laws.law([damping], [0.0]), FAR)
    errors = errors_of(problem, best, from_start(laws.law(), NEAR))["heldout_time"]
    assert errors["simulation_same_start"] == pytest.approx(errors["corrected"])


@pytest.mark.parametrize("kind", ["bias", "drift"])
def test_a_biased_or_drifting_sensor_is_corrected(tmp_path: Path, kind: str) -> None:
    name = make_problem(tmp_path, FAR).split.fit.names[0]
    error = 0.5 * (TIMES if kind == "drift" else np.ones_like(TIMES))
    problem = make_problem(tmp_path, FAR, **{name: error})
    fault = SensorFault(kind, name, 0.5, 0.01, None)
    best = from_start(laws.law(faults=(fault,)), FAR)
    found = errors_of(problem, best, from_start(laws.law(), FAR))
    errors = found["heldout_time"]
    assert errors["corrected"] < 0.05
    # The others read the sensor as it is, although their states are the same.
    assert errors["simulation_refit"] > 3 * errors["corrected"]
    assert found["heldout_restarted"]["corrected"] < 0.05


def test_a_sensor_without_a_known_error_is_left_out(tmp_path: Path) -> None:
    name = make_problem(tmp_path, FAR).split.fit.names[0]
    problem = make_problem(tmp_path, FAR, **{name: 5.0 * np.sin(37 * TIMES)})
    best = from_start(laws.law(faults=(SensorFault("spikes", name, 9, None, None),)), FAR)
    errors = errors_of(problem, best, from_start(laws.law(), FAR))["heldout_time"]
    assert errors["corrected"] < 0.05 and errors["simulation_refit"] < 0.05


def test_a_wrong_law_is_worse_at_test_sensors_and_in_held_out_time(tmp_path: Path) -> None:
    problem = make_problem(tmp_path, FAR)
    damping = laws.term(problem.system, "p", "p")
    wrong = from_start(laws.law([damping], [-0.1]), FAR)
    analysis = analysis_of(problem, wrong, from_start(laws.law(), FAR))
    found = {each["data"]: each for each in compare_held_out(predict_held_out(problem, analysis))}
    assert found["test_sensors"]["worse"] and found["heldout_time"]["worse"]
    assert found["heldout_restarted"]["after"] > found["heldout_restarted"]["before"]


def test_a_law_that_blows_up_is_worse(tmp_path: Path) -> None:
    problem = make_problem(tmp_path, FAR)
    cubic = laws.term(problem.system, "p", "x**3")
    wrong = from_start(laws.law([cubic], [50.0]), FAR)
    analysis = analysis_of(problem, wrong, from_start(laws.law(), FAR))
    assert not torch.isfinite(analysis.trajectories.states["corrected"]).all()
    predictions = predict_held_out(problem, analysis)
    assert held_out_errors(predictions)["heldout_time"]["corrected"] == np.inf
    assert all(each["worse"] for each in compare_held_out(predictions))


def test_a_small_error_grows_only_in_an_unstable_system(tmp_path: Path) -> None:
    problem = make_problem(tmp_path, FAR)
    rates = []
    # The last start is the nominal one.
    for strength, start in ((0.0, FAR), (2.0, FAR), (2.0, (1.0, 0.0))):
        push = laws.term(problem.system, "p", "p")
        best = from_start(laws.law([push], [strength]), start)
        rates.append(analysis_of(problem, best, best).trajectories.growth_rate)
    # The equation p' = -4 x + 2 p grows as exp(t).
    assert rates == pytest.approx([0.0, 1.0, 1.0], abs=0.1)
