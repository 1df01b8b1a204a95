"""Forecasts of a chaotic system are compared over a few Lyapunov times, not beyond."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from dashred.config import load_config
from dashred.core.findings.fit_schema import Comparison
from dashred.inference.fit.law import Law
from dashred.physics.runs.initial_state_prior import StartPrior, field_rms
from dashred.physics.solvers.simulate import simulate
from dashred.pipeline.analysis import Analysis
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import NominalRun
from dashred.pipeline.trajectories import simulate_trajectories
from dashred.pipeline.verification.comparison import compare_held_out
from dashred.pipeline.verification.held_out import predict_held_out
from tests import laws

# The Lorenz equations; the simulator lacks the term -y in the second.
TEXT = """
system:
  title: convection
  fields: {x: flow, y: temperature across, z: temperature up}
  equations: {x: 10*y - 10*x, y: 28*x - x*z, z: x*y - 2.667*z}
  start: {x: -6, y: -9, z: 21}
  spread: {x: 1, y: 1, z: 1}
  integrator: {method: rk4, dt: 0.01}
"""
STEP, COUNT, SIGMA = 0.04, 500, 0.15
START = (-6.5, -9.2, 21.5)


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    folder = tmp_path_factory.mktemp("lorenz")
    (folder / "lorenz.yaml").write_text(TEXT)
    system = laws.declared(folder, TEXT + "recording: {twin: a, sensors: 1, every: 0.04}\n")
    real = system.with_terms([(laws.term(system, "y", "y").terms[0], -1.0)])
    times = STEP * np.arange(COUNT)
    [states] = simulate(real, torch.tensor([START], dtype=torch.float64), torch.from_numpy(times))
    noise = SIGMA * np.random.default_rng(3).standard_normal((COUNT, 2))
    table = np.column_stack([times, states[:, :2].numpy() + noise])
    np.savetxt(folder / "r.csv", table, "%.9g", ",", header="time,x,y", comments="")
    (folder / "lorenz.yaml").write_text(TEXT)
    words = [f"conf={folder}/lorenz.yaml", f"recording.path={folder}/r.csv"]
    return build_problem(load_config(words, entry="train"))


def compared(problem: Problem, best: Law, uncorrected: Law) -> dict[str, Comparison]:
    start = torch.tensor([[-6.0, -9.0, 21.0]], dtype=torch.float64)
    [states] = simulate(problem.system, start, problem.times)
    nominal = NominalRun(StartPrior(problem.system, start[0], field_rms(states), None), states)
    discovered = laws.discovery(best, uncorrected=uncorrected)
    runs = simulate_trajectories(problem, nominal, discovered, {})
    # The largest Lyapunov exponent of the Lorenz equations is 0.906.
    assert runs.growth_rate == pytest.approx(0.9, abs=0.35)
    assimilated: Any = SimpleNamespace(others=(), shred=states, dashred=states)
    nothing: Any = None
    analysis = Analysis(nominal, nothing, assimilated, discovered, runs, nothing, states)
    found = compare_held_out(predict_held_out(problem, analysis))
    return {each["data"]: each for each in found}


def law(problem: Problem, coefficient: float) -> Law:
    start = torch.tensor([START], dtype=torch.float64) + 0.02
    found = laws.law([laws.term(problem.system, "y", "y")], [coefficient])
    return Law(**{**vars(found), "start": start})


def test_the_right_law_forecasts_better_after_each_restart(problem: Problem) -> None:
    found = compared(problem, law(problem, -0.99), law(problem, 0.0))
    # The free run is lost before the held-out time.
    assert "heldout_time" not in found
    again = found["heldout_restarted"]
    assert again["after"] < 0.5 * again["before"] and not again["worse"]
    assert not any(each["worse"] for each in found.values())


def test_a_wrong_law_forecasts_worse_after_each_restart(problem: Problem) -> None:
    found = compared(problem, law(problem, 0.5), law(problem, 0.0))
    assert found["heldout_restarted"]["after"] > found["heldout_restarted"]["before"]
