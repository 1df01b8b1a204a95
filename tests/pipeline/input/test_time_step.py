"""A time step is chosen where none is given: as long as the noise allows, and no longer."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
import yaml

import dashred
from dashred.config import Config, load_config
from dashred.core.errors import InputError
from dashred.physics.solvers.simulate import simulate
from dashred.pipeline import simulation_runs
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.problem import Problem

NOISE = 0.02


def van_der_pol(stiffness: float, **changes: Any) -> dict[str, Any]:
    system = {
        "title": "Van der Pol",
        "fields": {"x": "x", "y": "y"},
        "parameters": {"mu": stiffness},
        "equations": {"x": "y", "y": "mu*(1 - x**2)*y - x"},
        "start": {"x": 2.0, "y": 0.0},
        "spread": {"x": 0.1, "y": 0.1},
        "integrator": {"method": "rk4"},
    }
    return {"system": system | changes}


def problem_of(folder: Path, values: dict[str, Any], frame: pd.DataFrame) -> Problem:
    (folder / "system.yaml").write_text(yaml.safe_dump(values))
    frame.to_csv(folder / "recording.csv", index=False)
    return build_problem(config_of(folder))


def config_of(folder: Path) -> Config:
    words = [f"conf={folder / 'system.yaml'}", f"recording.path={folder / 'recording.csv'}"]
    return load_config(words, entry="train")


def recorded(stiffness: float) -> pd.DataFrame:
    """Return noisy readings of an oscillator, integrated with very short steps."""
    times, substeps = np.linspace(0, 20, 201), 400
    state, states = np.array([2.0, 0.0]), []

    def rate(s: np.ndarray) -> np.ndarray:
        return np.array([s[1], stiffness * (1 - s[0] ** 2) * s[1] - s[0]])

    h = 0.1 / substeps
    for _ in times:
        states.append(state)
        for _ in range(substeps):
            middle = state + h / 2 * rate(state)
            state = state + h * rate(middle)
    noise = np.random.default_rng(1).standard_normal((len(times), 2))
    x, y = (np.stack(states) * (1 + 0 * noise) + NOISE * noise).T
    return pd.DataFrame({"time": times, "x": x, "y": y})


def segment_error(problem: Problem) -> float:
    """Return the largest error over four samples against steps 16 times as short, in σ."""
    fine = problem.system.with_step(problem.system.dt / 16)
    fit = problem.split.fit
    states = torch.from_numpy(fit.values)
    worst = 0.0
    for first in range(0, len(states) - 4, 8):
        clock = problem.times[first : first + 5]
        pair = [simulate(s, states[first][None], clock)[0] for s in (problem.system, fine)]
        error = (pair[0] - pair[1]).square().mean(dim=0).sqrt()
        worst = max(worst, float((error / problem.fit_noise_std()).max()))
    return worst


@pytest.mark.parametrize("stiffness", [0.5, 8.0])
def test_the_error_over_a_segment_is_below_a_twentieth_of_the_noise(
    tmp_path: Path, stiffness: float
) -> None:
    problem = problem_of(tmp_path, van_der_pol(stiffness), recorded(stiffness))
    # The states are noisy readings, off the trajectory at which the step was chosen.
    assert segment_error(problem) < 1.5 / 20
    assert "time step: " in problem.clock


def test_a_stiffer_system_gets_a_shorter_step_that_divides_the_interval(tmp_path: Path) -> None:
    steps = []
    for stiffness in (0.5, 8.0):
        problem = problem_of(tmp_path, van_der_pol(stiffness), recorded(stiffness))
        steps.append(problem.system.dt)
        assert math.log2(0.1 / problem.system.dt) == pytest.approx(
            round(math.log2(0.1 / problem.system.dt))
        )
    assert steps[1] < steps[0]
    assert steps[0] > 0.1 / 16


def test_a_given_step_stays(tmp_path: Path) -> None:
    values = van_der_pol(0.5, integrator={"method": "rk4", "dt": 0.03})
    problem = problem_of(tmp_path, values, recorded(0.5))
    assert problem.system.dt == 0.03
    assert "time step" not in problem.clock


def test_a_field_gets_a_stable_step(tmp_path: Path) -> None:
    # Explicit steps of diffusion are stable below dx²/(2 D) times a constant of the method.
    values = {
        "system": {
            "title": "Diffusion",
            "axes": {"x": {"length": "2*pi", "points": 32}},
            "fields": {"u": "heat"},
            "equations": {"u": "0.3*lap(u)"},
            "start": {"u": "1 + 0.5*cos(x)"},
            "spread": {"u": 0.1, "length": 1.0},
            "integrator": {"space": "finite-difference"},
        },
        "recording": {"sensors": str(tmp_path / "sensors.csv")},
        "splits": {"sensors": {"validate": 0, "test": 0}},
    }
    places = np.linspace(0.3, 6.0, 4)
    pd.DataFrame(
        {"name": [f"s{k}" for k in range(4)], "field": "u", "x": places, "std": NOISE}
    ).to_csv(tmp_path / "sensors.csv", index=False)
    times = np.linspace(0, 4, 41)
    frame = pd.DataFrame({"time": times})
    rng = np.random.default_rng(2)
    for k, place in enumerate(places):
        exact = 1 + 0.5 * np.exp(-0.3 * times) * np.cos(place)
        frame[f"s{k}"] = exact + NOISE * rng.standard_normal(len(times))
    problem = problem_of(tmp_path, values, frame)
    system = problem.system
    start = 1 + 0.5 * torch.cos(torch.arange(32).double() * 2 * math.pi / 32)
    path = simulate(system, start[None, None], problem.times)[0, :, 0]
    exact = 1 + 0.5 * torch.exp(-0.3 * problem.times)[:, None] * torch.cos(
        torch.arange(32).double() * 2 * math.pi / 32
    )
    assert float((path - exact).abs().max()) < NOISE / 2


def test_a_step_that_amplifies_rounding_errors_over_the_record_is_not_chosen(
    tmp_path: Path,
) -> None:
    """The start is smooth: in a few samples nothing is seen of the waves that are unstable."""
    values = {
        "system": {
            "title": "String",
            "axes": {"x": {"length": 10, "points": 32, "ends": "fixed"}},
            "fields": {"w": "deflection", "p": "momentum"},
            "equations": {"w": "p", "p": "lap(w)"},
            "start": {"w": "sin(pi*x/10)", "p": 0},
            "spread": {"w": 0.1, "p": 0.1, "length": 1.5},
        },
        "recording": {"sensors": str(tmp_path / "sensors.csv")},
        "splits": {"sensors": {"validate": 0, "test": 0}},
    }
    places = np.array([2.0, 5.0, 7.0])
    rows = {"name": ["a", "b", "c"], "field": "w", "x": places, "std": NOISE}
    pd.DataFrame(rows).to_csv(tmp_path / "sensors.csv", index=False)
    times = np.linspace(0, 60, 121)
    exact = np.cos(0.1 * math.pi * times[:, None]) * np.sin(0.1 * math.pi * places)
    noisy = exact + NOISE * np.random.default_rng(2).standard_normal(exact.shape)
    frame = pd.DataFrame({"time": times, "a": noisy[:, 0], "b": noisy[:, 1], "c": noisy[:, 2]})
    system = problem_of(tmp_path, values, frame).system
    # The largest wavenumber is 10, and Runge-Kutta steps of a wave are stable below sqrt(8)/10.
    assert 0.1 < system.dt < math.sqrt(8) / (32 * math.pi / 10)


def test_a_simulator_that_blows_up_keeps_a_step_for_its_beginning(tmp_path: Path) -> None:
    values = van_der_pol(0.5, equations={"x": "y", "y": "y + 0.5*x**3"})
    problem = problem_of(tmp_path, values, recorded(0.5))
    assert 0 < problem.system.dt <= 0.1


def test_without_time_to_choose_the_last_step_tried_is_taken(tmp_path: Path) -> None:
    values = van_der_pol(0.5) | {"budget": 1e-6}
    problem = problem_of(tmp_path, values, recorded(0.5))
    assert problem.system.dt == pytest.approx(0.1)
    assert "the last one tried: the budget gives no more time" in problem.clock


def test_a_twin_needs_a_step(tmp_path: Path) -> None:
    values = van_der_pol(0.5) | {"recording": {"twin": "a", "duration": 5, "every": 0.1}}
    (tmp_path / "system.yaml").write_text(yaml.safe_dump(values))
    with pytest.raises(InputError, match="a twin needs a time step"):
        load_config([f"conf={tmp_path / 'system.yaml'}"], entry="train")


def test_a_notebook_simulates_with_the_chosen_step() -> None:
    problem = dashred.Problem.from_dict(van_der_pol(0.5), recording=recorded(0.5))
    states = problem.simulate(times=[0.0, 0.1, 0.2])
    assert np.isfinite(states["x"].to_numpy()).all()
    alone = dashred.Problem.from_dict(van_der_pol(0.5))
    with pytest.raises(InputError, match="no time step"):
        alone.simulate(times=[0.0, 0.1])


def test_a_stated_step_that_is_too_long_for_an_ode_system_is_halved(tmp_path: Path) -> None:
    """The readings are exact, so the error of the stated step would pass for physics."""
    times = np.arange(0, 40, 0.5)
    frame = pd.DataFrame({"time": times, "x": np.cos(2 * times), "v": -2 * np.sin(2 * times)})
    values = {
        "system": {
            "title": "Spring",
            "fields": {"x": "place", "v": "speed"},
            "equations": {"x": "v", "v": "-4*x"},
            "start": {"x": 1.0, "v": 0.0},
            "spread": {"x": 0.05, "v": 0.05},
            "integrator": {"method": "rk4", "dt": 0.5},
        },
        "simulation": {"members": 24, "held_out": 6},
    }
    simulated = simulation_runs.simulate(problem_of(tmp_path, values, frame), {})
    assert simulated.problem.system.dt == 0.25
    assert "time step: 0.25, half of the stated one" in simulated.problem.clock
    assert simulated.resolution.resolved and simulated.segments is not None


def test_fixed_steps_take_the_place_of_an_adaptive_method(tmp_path: Path) -> None:
    frame = recorded(2.0)
    adaptive = van_der_pol(2.0, integrator={"method": "dopri5", "dt": 0.05})
    problem = problem_of(tmp_path, adaptive, frame)
    fixed = problem_of(tmp_path, van_der_pol(2.0), frame)
    assert problem.system.method == "rk4"
    assert problem.system.dt == fixed.system.dt
    assert f"{problem.system.dt:.6g} of rk4 in place of dopri5" in problem.clock
    assert problem.config.system.integrator.method == "dopri5"
    assert "in place" not in fixed.clock
