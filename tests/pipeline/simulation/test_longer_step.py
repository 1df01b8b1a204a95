"""The ensemble and the derivatives use the longest time step that is harmless."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from dashred.config import load_config
from dashred.physics.solvers.simulate import simulate
from dashred.pipeline.input.build_problem import build_problem
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


WAVES = """
system:
  title: waves of two coupled fields
  axes: {x: {length: 10, points: 64}}
  fields: {p: real part, q: imaginary part}
  equations: {p: -0.5*lap(q), q: 0.5*lap(p)}
  start: {p: 1 + 0.3*cos(2*pi*x/10), q: 0}
  spread: {p: 0.2, q: 0.2}
  integrator: {dt: 0.0125}
recording: {path: waves.csv, sensors: places.csv}
"""


def test_a_step_that_amplifies_rounding_errors_is_not_used(tmp_path: Path) -> None:
    """The largest wavenumber turns by ``k²/2 dt``, and the method bears no more than 2.8."""
    times = 0.025 * np.arange(101)
    turns = 0.5 * (2 * np.pi / 10) ** 2 * times
    rows = [times, *(1 + 0.3 * np.cos(turns) * np.cos(2 * np.pi * x / 10) for x in (0, 2, 4, 6, 8))]
    header = "time,a,b,c,d,e"
    np.savetxt(
        tmp_path / "waves.csv", np.column_stack(rows), delimiter=",", header=header, comments=""
    )
    places = [f"{name},p,{x}" for name, x in zip("abcde", (0, 2, 4, 6, 8), strict=True)]
    (tmp_path / "places.csv").write_text("\n".join(["name,field,x", *places]) + "\n")
    (tmp_path / "case.yaml").write_text(WAVES)
    problem = build_problem(load_config([f"conf={tmp_path / 'case.yaml'}"], entry="train"))
    largest = 0.5 * (2 * np.pi * 32 / 10) ** 2
    assert 0.0125 * largest < 2.8 < 0.025 * largest
    found = with_longer_step(problem, simulate_nominal(problem, {}))
    assert found.ensemble_system.dt == 0.0125


def test_a_stated_step_is_kept(tmp_path: Path) -> None:
    problem = problem_of(tmp_path, 0.02, "0.05")
    found = with_longer_step(problem, simulate_nominal(problem, {}))
    assert found.longer_dt is None and found.ensemble_system.dt == pytest.approx(0.05)
    assert torch.equal(found.times, problem.times)
