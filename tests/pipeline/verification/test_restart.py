"""A forecast from a fresh state: right with the law, wrong without, blind to what it forecasts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from dashred.config import load_config
from dashred.inference.fit.law import FittedParameter, Law, SensorFault
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.problem import Problem
from dashred.pipeline.verification.restart import FIT_SAMPLES, restart
from tests import laws

TEXT = """
system:
  title: a swing
  fields: {x: place, p: momentum}
  parameters: {k: 4.0}
  equations: {x: p, p: -k*x}
  start: {x: 1, p: 0}
  integrator: {method: rk4, dt: 0.02}
"""
NOTHING = laws.law()
TIMES, DAMPING, SIGMA = 0.05 * np.arange(401), -0.1, 0.002


def law(system: System, start: Tensor) -> Law:
    damping = torch.tensor([DAMPING], dtype=torch.float64)
    one = torch.ones((1, 1), dtype=torch.float64)
    return Law((laws.term(system, "p", "p"),), damping, one, start, 0.0, 1.0, torch.zeros(1))


def make_problem(
    folder: Path, tail: float = 0.0, momentum_off: float | None = None
) -> tuple[Problem, Tensor]:
    """Return a recording of the place of a damped swing, whose last fifth may be tampered with.

    Of its momentum, too, if it is said how far off that reads.
    """
    (folder / "swing.yaml").write_text(TEXT)
    system = laws.declared(folder, TEXT + "recording: {twin: a, sensors: 1, every: 0.05}\n")
    real = system.with_terms([(laws.term(system, "p", "p").terms[0], DAMPING)])
    start = torch.tensor([[1.0, 0.2]], dtype=torch.float64)
    [states] = simulate(real, start, torch.from_numpy(TIMES))
    noise = SIGMA * np.random.default_rng(0).standard_normal(len(TIMES))
    read = states[:, 0].numpy() + noise + tail * (TIMES > 16.0)
    columns = {"time": TIMES, "x": read}
    if momentum_off is not None:
        columns["p"] = states[:, 1].numpy() + momentum_off
    table = np.column_stack(list(columns.values()))
    header = ",".join(columns)
    np.savetxt(folder / "swing.csv", table, "%.9g", ",", header=header, comments="")
    words = [f"conf={folder}/swing.yaml", f"recording.path={folder}/swing.csv"]
    return build_problem(load_config(words, entry="train")), states


def test_with_the_law_it_is_right_and_without_it_drifts(tmp_path: Path) -> None:
    problem, states = make_problem(tmp_path)
    fit = len(problem.split.fit.times)
    [(part, runs)] = restart(problem, law(problem.system, states[0]), NOTHING, states[:fit])
    assert part == slice(0, len(TIMES) - fit)
    assert {run.shape for run in runs.values()} == {(len(TIMES) - fit, 2)}
    before, after = (
        float((runs[name] - states[fit:]).square().mean().sqrt())
        for name in ("simulation_refit", "corrected")
    )
    assert after < 2 * SIGMA and before > 20 * after


def test_nothing_of_the_held_out_time_has_a_part_in_it(tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()
    (tmp_path / "two").mkdir()
    problem, states = make_problem(tmp_path / "one")
    other, _ = make_problem(tmp_path / "two", tail=5.0)
    fit = len(problem.split.fit.times)
    assert not np.array_equal(problem.split.heldout.values, other.split.heldout.values)
    found = law(problem.system, states[0])
    [(_, runs)], [(_, again)] = (
        restart(each, found, NOTHING, states[:fit]) for each in (problem, other)
    )
    for name, run in runs.items():
        assert torch.equal(run, again[name])


def test_only_the_last_samples_are_fitted(tmp_path: Path) -> None:
    problem, states = make_problem(tmp_path)
    fit = len(problem.split.fit.times)
    found = law(problem.system, states[0])
    [(_, runs)] = restart(problem, found, NOTHING, states[:fit])
    problem.split.fit.values[: fit - FIT_SAMPLES] += 3.0
    [(_, again)] = restart(problem, found, NOTHING, states[:fit])
    # σ keeps its floor in the traces' std, which has grown: it weighs all samples alike.
    torch.testing.assert_close(again["corrected"], runs["corrected"], rtol=1e-4, atol=1e-4)


def test_a_sensor_at_fault_has_no_part_in_it(tmp_path: Path) -> None:
    (tmp_path / "alone").mkdir()
    alone, states = make_problem(tmp_path / "alone")
    problem, _ = make_problem(tmp_path, momentum_off=0.7)
    fit = len(problem.split.fit.times)
    sound = law(problem.system, states[0])
    faulty = replace(sound, faults=(SensorFault("bias", "p", 0.7, 0.01, None),))
    [(_, misled)], [(_, runs)] = (
        restart(problem, found, NOTHING, states[:fit]) for found in (sound, faulty)
    )
    [(_, expected)] = restart(alone, sound, NOTHING, states[:fit])
    for name, run in expected.items():
        torch.testing.assert_close(runs[name], run, rtol=1e-6, atol=1e-6)
        assert float((misled[name] - run).abs().max()) > 0.05


def test_without_held_out_time_there_is_nothing_to_forecast(tmp_path: Path) -> None:
    problem, states = make_problem(tmp_path)
    assert restart(problem, law(problem.system, states[0]), NOTHING, states) == []


def test_without_the_law_fitted_parameters_have_their_values(tmp_path: Path) -> None:
    problem, states = make_problem(tmp_path)
    stiff = laws.parameter(problem.system, "k")
    fit = len(problem.split.fit.times)
    nothing = replace(NOTHING, parameters=(FittedParameter(stiff, -1.0, 0.1),))
    found = law(problem.system, states[0])
    [(_, runs)] = restart(problem, found, nothing, states[:fit])
    [(_, plain)] = restart(problem, found, NOTHING, states[:fit])
    assert torch.equal(runs["corrected"], plain["corrected"])
    # The stiffness is 3 instead of 4.
    own = problem.with_parameters({"k": 3.0})
    [(_, expected)] = restart(own, found, NOTHING, states[:fit])
    torch.testing.assert_close(runs["simulation_refit"], expected["simulation_refit"])
    assert float((runs["simulation_refit"] - plain["simulation_refit"]).abs().max()) > 0.1


def test_a_run_that_blows_up_does_not_spoil_the_other(tmp_path: Path) -> None:
    problem, states = make_problem(tmp_path)
    fit = len(problem.split.fit.times)
    blown_up = states[:fit].clone()
    blown_up[-20:] *= 10.0 ** torch.arange(20, dtype=torch.float64)[:, None] * 1e150
    found = law(problem.system, states[0])
    [(_, bounded)] = restart(problem, found, NOTHING, states[:fit])
    [(_, runs)] = restart(problem, found, NOTHING, blown_up)
    for name, run in bounded.items():
        assert float((runs[name] - run).abs().max()) < SIGMA
