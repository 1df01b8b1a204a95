"""Whole runs on recordings of several episodes: one law, and an episode that nothing has seen."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import xarray as xr

from dashred.config import load_config
from dashred.data.episodes import Episode, Episodes
from dashred.data.io.write_netcdf import write_netcdf
from dashred.data.observation_operator import ObservationOperator
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from tests.conftest import QUICK, Ended

pytestmark = pytest.mark.slow

SMALL = """\
simulation: {members: 24, held_out: 6, terms: 1}
shred: {lags: 5, latent: 8, decoder: [16], modes: 2, epochs: 2, steps: 4, batch: 8}
assimilation: {epochs: 2, width: 8}
latent_sindy: {steps: [1, 2], bootstraps: 3, begins: 3}
threads: 1
"""
OSCILLATOR = f"""\
system:
  title: an oscillator
  fields: {{x: place, p: momentum}}
  parameters: {{k: 2.0}}
  equations: {{x: p, p: -k*x}}
  start: {{x: 0.5, p: 0}}
  spread: {{x: 1.0, p: 1.0}}
  integrator: {{method: rk4, dt: 0.05}}
library: {{x: [x], p: ["1", x, p, x**3, p**3, "abs(p)*p", x**2]}}
{SMALL}"""
DRIVEN = OSCILLATOR.replace("p: -k*x}\n", "p: -k*x + f}\n  inputs: {f: force}\n")
SIGMA = 0.02
# Name, start, first time, samples: one begins at t = 60, the last is held out.
STARTS = [
    ("short", (-0.6, 0.8), 60.0, 91),
    ("long", (1.0, 0.2), 0.0, 131),
    ("kept back", (0.5, -1.1), 5.0, 101),
]


def damped(start: tuple[float, float], passed: np.ndarray) -> np.ndarray:
    """Return the exact ``x'' = -2 x - 0.15 x'`` and its momentum, ``(time, 2)``."""
    (x, p), g = start, 0.075
    w = np.sqrt(2.0 - g**2)
    a, b = x, (p + g * x) / w
    decay, cos, sin = np.exp(-g * passed), np.cos(w * passed), np.sin(w * passed)
    place = decay * (a * cos + b * sin)
    return np.stack([place, -g * place + decay * w * (b * cos - a * sin)], axis=1)


def findings_of(ended: Ended) -> dict[str, Any]:
    assert ended.code == 0, ended.err
    return json.loads(ended.read("findings.json"))


def assert_the_damping_is_found(found: dict[str, Any]) -> None:
    assert found["verdict"] == "missing-term"
    [term] = found["terms"]
    assert (term["equation"], term["term"]) == ("p", "p")
    low, high = term["ci95"]
    assert low < -0.15 < high
    assert high - low < 0.05


def test_a_damped_oscillator_in_three_episodes(train, tmp_path: Path) -> None:
    # Third differences of so few samples estimate the noise to 13 % (standard deviation over 200
    # seeds). At the seed 0 the error is 4 %; at the worst one, 54 %.
    rng = np.random.default_rng(0)
    lines = ["time,episode,x,p"]
    for name, start, begin, count in STARTS:
        passed = 0.1 * np.arange(count)
        passed[1:-1] += rng.uniform(-0.02, 0.02, count - 2)
        read = damped(start, passed) + SIGMA * rng.standard_normal((count, 2))
        for i, (x, p) in enumerate(read):
            # A gap, a sensor that is out for a while, and times that are a little off.
            if name == "long" and 40 <= i < 44:
                continue
            shown = "" if name == "short" and 20 <= i < 25 else f"{x:.6f}"
            lines.append(f"{begin + passed[i]:.7g},{name},{shown},{p:.6f}")
    (tmp_path / "r.csv").write_text("\n".join(lines) + "\n")
    (tmp_path / "oscillator.yaml").write_text(OSCILLATOR)
    words = f"conf={tmp_path / 'oscillator.yaml'}", f"recording.path={tmp_path / 'r.csv'}"
    ended = train(*words, "recording.every=0.1", figures=True)
    found = findings_of(ended)
    assert_the_damping_is_found(found)
    fit = found["fit"]
    assert set(fit["noise_std"]) == {"x", "p"}
    assert all(0.8 * SIGMA < std < 1.2 * SIGMA for std in fit["noise_std"].values())
    assert all(0.8 * SIGMA < std < 1.2 * SIGMA for std in fit["residual_std"].values())
    assert set(fit["held_out_samples"]) == {
        "heldout_time",
        "heldout_restarted",
        "heldout_episode",
    }
    held = fit["heldout_episode"]
    assert held["corrected"] < 0.3 * held["simulation_refit"]
    assert fit["heldout_time"]["corrected"] < 0.3 * fit["heldout_time"]["simulation_refit"]
    listed = {part["name"]: part for part in found["input"]["splits"]["episodes"]}
    assert [*listed] == ["long", "short", "kept back"]
    assert listed["short"]["begin"] == 60 and listed["short"]["time_end"] == pytest.approx(67.2)
    assert listed["kept back"]["held_out_whole"]
    assert listed["kept back"]["time_end"] == pytest.approx(6.0)
    with xr.open_dataset(ended.output / "estimates.nc", engine="h5netcdf") as estimates:
        assert set(estimates["episode"].values.tolist()) == {"long", "short"}
        corrected = estimates["x"].sel({"method": "corrected"})[
            estimates["episode"].values == "short"
        ]
        passed = corrected["time"].values - 60
        error = corrected.values - damped(STARTS[0][1], passed)[:, 0]
    assert np.sqrt(np.mean(error**2)) < SIGMA
    for name in ("sensor_traces.png", "sensor_traces_2.png", "held_out_episode.png"):
        assert (ended.output / name).is_file()
    assert "kept back" in ended.out and "held out, its start" in ended.out


def test_inputs_of_their_own_drive_two_episodes(train, tmp_path: Path) -> None:
    (tmp_path / "driven.yaml").write_text(DRIVEN)
    rng = np.random.default_rng(6)
    lines = ["time,episode,x,p,force"]
    for name, frequency, count in (("slow", 0.7, 121), ("fast", 2.2, 101)):
        times = 0.1 * np.arange(count)
        force = np.sin(frequency * times)
        # The recording's own straight lines drive the truth, in steps far below its own.
        state, path = np.array([0.5, 0.0]), []
        for i in range(count):
            path.append(state)
            for j in range(20):
                t = times[i] + 0.005 * j

                def rate(s: np.ndarray, t: float, times=times, force=force) -> np.ndarray:
                    f = np.interp(t, times, force)
                    return np.array([s[1], -2 * s[0] - 0.15 * s[1] + f])

                k1 = rate(state, t)
                k2 = rate(state + 0.0025 * k1, t + 0.0025)
                state = state + 0.005 * k2
        read = np.array(path) + SIGMA * rng.standard_normal((count, 2))
        lines += [
            f"{t:.7g},{name},{x:.6f},{p:.6f},{f:.8f}"
            for t, (x, p), f in zip(times, read, force, strict=True)
        ]
    (tmp_path / "r.csv").write_text("\n".join(lines) + "\n")
    words = f"conf={tmp_path / 'driven.yaml'}", f"recording.path={tmp_path / 'r.csv'}"
    found = findings_of(train(*words))
    assert_the_damping_is_found(found)
    assert "heldout_episode" not in found["fit"]
    assert len(found["input"]["splits"]["episodes"]) == 2


def test_a_flow_in_two_episodes(train, tmp_path: Path) -> None:
    text = "\n".join(line for line in QUICK.splitlines() if "twin: a" not in line)
    (tmp_path / "flow.yaml").write_text(text)
    path = f"recording.path={tmp_path / 'r.nc'}"
    config = load_config([f"conf={tmp_path / 'flow.yaml'}", path], entry="test")
    system = System(config.system, config.where)
    fine = system.with_terms([]).with_step(0.025)
    term = system.config.equations["u"]
    fine.config.equations["u"] = f"{term} - 0.1*u"
    truth = System(fine.config, config.where)
    rng = np.random.default_rng(7)
    sensors = tuple(Sensor(f"s{i}", "u", (0.3 + 0.9 * i,), 0.01) for i in range(6))
    x = truth.grid.coordinates["x"]
    parts = []
    for name, begin, count, state in (
        ("first", 0.0, 41, 1 + 0.5 * torch.sin(x) + 0.08 * torch.cos(2 * x)),
        ("second", 10.0, 31, 0.9 + 0.55 * torch.sin(x + 0.1)),
    ):
        times = begin + 0.1 * torch.arange(count, dtype=torch.float64)
        states = simulate(truth, state[None, None], times)
        clean = ObservationOperator(sensors, truth)(states)[0].numpy()
        values = clean + 0.01 * rng.standard_normal(clean.shape)
        parts.append(Episode(name, Recording(sensors, times.numpy(), values)))
    write_netcdf(Episodes(tuple(parts)), tmp_path / "r.nc")
    found = findings_of(train(f"conf={tmp_path / 'flow.yaml'}", path))
    [term] = found["terms"]
    low, high = term["ci95"]
    assert term["term"] == "u" and low < -0.1 < high
    tested = found["fit"]["test_sensors"]
    assert tested["corrected"] < 0.5 * tested["simulation_refit"]
