"""The ensemble and the derivatives use the longest time step that is harmless."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from dashred.config import load_config
from dashred.physics.solvers.simulate import simulate
from dashred.pipeline.build_problem import build_problem
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.longer_step import LIMIT, with_longer_step
from dashred.pipeline.simulation.nominal_run import simulate_nominal

CASE = """
system:
  title: oscillator
  fields: {x: place, v: velocity}
  equations: {x: v, v: -x - 0.1*x**3}
  start: {x: 1, v: 0}
  spread: {x: 0.1, v: 0.1}
  integrator: {dt: DT}
recording: {path: recording.csv}
simulation: {dt: STATED}
"""


def problem_of(folder: Path, dt: float, stated: str = "null") -> Problem:
    """Return the problem of a recording with a sample every 0.2."""
    times = 0.2 * np.arange(101)
    rows = np.column_stack([times, np.cos(times), -np.sin(times)])
    np.savetxt(folder / "recording.csv", rows, delimiter=",", header="time,x,v", comments="")
    (folder / "case.yaml").write_text(
        CASE.replace("DT", str(dt)).replace("STATED", stated), encoding="utf-8"
    )
    return build_problem(load_config([f"conf={folder / 'case.yaml'}"], entry="train"))


@pytest.mark.parametrize(("dt", "longer"), [(0.02, 0.16), (0.1, 0.2), (0.2, None)])
def test_the_step_is_at_most_eight_times_as_long_and_no_longer_than_a_sample(
    tmp_path: Path, dt: float, longer: float | None
) -> None:
    problem = problem_of(tmp_path, dt)
    found = with_longer_step(problem, simulate_nominal(problem, {}))
    assert found.longer_dt == (None if longer is None else pytest.approx(longer))
    assert found.system.dt == dt and found.ensemble_system.dt == pytest.approx(longer or dt)


def test_the_readings_hardly_change(tmp_path: Path) -> None:
    problem = problem_of(tmp_path, 0.1)
    nominal = simulate_nominal(problem, {})
    found = with_longer_step(problem, nominal)
    start = nominal.states[None, 0]
    longer = simulate(found.ensemble_system, start, problem.times)[0]
    change = (longer - nominal.states).square().mean(dim=0).sqrt() / nominal.states.std(dim=0)
    assert 0 < float(change.max()) < LIMIT


def test_a_step_at_which_the_readings_change_is_not_used(tmp_path: Path) -> None:
    problem = problem_of(tmp_path, 0.1)
    nominal = simulate_nominal(problem, {})
    fast = replace(problem.system.config, equations={"x": "20*v", "v": "-20*x"})
    quick = replace(problem, system=problem.system.with_config(fast))
    assert with_longer_step(quick, nominal).longer_dt is None


def test_a_stated_step_is_kept(tmp_path: Path) -> None:
    problem = problem_of(tmp_path, 0.02, "0.05")
    found = with_longer_step(problem, simulate_nominal(problem, {}))
    assert found.longer_dt is None and found.ensemble_system.dt == pytest.approx(0.05)
    assert torch.equal(found.times, problem.times)
