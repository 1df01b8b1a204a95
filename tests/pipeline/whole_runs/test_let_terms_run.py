"""A whole run in which a rate that three equations share lacks an inhibition."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.integrate import solve_ivp

from tests.pipeline.whole_runs.test_episodes_run import findings_of

pytestmark = pytest.mark.slow

BATCH = """
system:
  title: Cells in a batch
  fields: {X: living cells, G: glucose, W: waste}
  parameters: {mu: 0.06, K: 1.5, Y: 0.1, a: 1.4}
  let: {m: mu*G/(K + G)}
  equations: {X: m*X, G: -m*X/Y, W: a*m*X}
  start: {X: 0.5, G: 22, W: 2}
  spread: {X: 0.2, G: 2, W: 1}
  integrator: {method: rk4, dt: 0.5}
recording: {path: recording.csv}
"""
INHIBITION = -0.06
STARTS = {"first": (0.4, 21.0, 2.0), "second": (0.6, 24.0, 4.0), "third": (0.5, 18.0, 1.0)}
NOISE = np.array([0.01, 0.1, 0.03])


def tendency(_: float, state: np.ndarray) -> list[float]:
    cells, glucose, waste = state
    rate = 0.06 * glucose / (1.5 + glucose) * (1 + INHIBITION * waste)
    return [rate * cells, -rate * cells / 0.1, 1.4 * rate * cells]


def record(path: Path) -> None:
    rng, times = np.random.default_rng(4), np.arange(0, 121, 2.0)
    lines = ["time,episode,X,G,W"]
    for name, start in STARTS.items():
        solved = solve_ivp(tendency, (0, 120), start, t_eval=times, rtol=1e-9, atol=1e-9)
        read = solved.y.T + NOISE * rng.standard_normal((len(times), 3))
        lines += [
            ",".join([f"{t:g}", name, *(f"{value:.6f}" for value in row)])
            for t, row in zip(times, read, strict=True)
        ]
    path.write_text("\n".join(lines) + "\n")


def test_one_change_of_a_shared_rate_is_found(train: Any, tmp_path: Path) -> None:
    record(tmp_path / "recording.csv")
    config = tmp_path / "batch.yaml"
    config.write_text(BATCH)
    ended = train(f"conf={config}", figures=True)
    found = findings_of(ended)
    assert found["verdict"] == "missing-term"
    [term] = found["terms"]
    assert (term["equation"], term["term"]) == ("m", "W*m")
    low, high = term["ci95"]
    assert low < INHIBITION < high and high - low < 0.01
    assert "a change of m in the equations of X, G and W" in term["says"]
    held = found["fit"]["heldout_episode"]
    assert held["corrected"] < 0.3 * held["simulation_refit"]
    corrected = yaml.safe_load(ended.read("corrected.yaml"))["system"]
    assert corrected["equations"]["X"] == "m*X" and "W" in corrected["let"]["m"]
    assert "let m" in (ended.output / "report.html").read_text()
