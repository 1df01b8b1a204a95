"""A start has as many modes as the readings show."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from dashred.config import load_config
from dashred.physics.runs.initial_state_prior import fitted_modes
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.simulation.nominal_run import simulate_nominal

STRING = """
  fields: {u: place, v: velocity}
  equations: {u: v, v: lap(u)}
  start: {u: sin(x), v: 0}
"""
DAMPED = STRING.replace("u: v, v: lap(u)", "u: 2*lap(u), v: 2*lap(v)")
TEXT = """
system:
  title: waves
  axes: {x: {length: 6.283185307, points: 48}}
BODY
  spread: {u: 0.5, v: 0.5, length: 0.9SPREAD}
  integrator: {dt: 0.02}
recording: {path: recording.csv, sensors: sensors.csv}
"""
PLACES = np.linspace(0.2, 6.0, 9)


def modes(folder: Path, body: str, noise: float, spread: str = "") -> tuple[int, int]:
    """Return the number of modes, and how many hold nearly all of the variance."""
    times = np.arange(0, 12, 0.1)
    rng = np.random.default_rng(1)
    seen = np.sin(PLACES) * np.cos(times)[:, None] + noise * rng.standard_normal((len(times), 9))
    names = [f"s{i}" for i in range(9)]
    table = pd.DataFrame(seen, columns=names).assign(time=times)
    table.to_csv(folder / "recording.csv", index=False)
    sensors = pd.DataFrame({"name": names, "field": "u", "x": PLACES, "std": noise})
    sensors.to_csv(folder / "sensors.csv", index=False)
    path = folder / "waves.yaml"
    path.write_text(TEXT.replace("BODY", body.strip("\n")).replace("SPREAD", spread))
    problem = build_problem(load_config([f"conf={path}"], entry="train"))
    return len(simulate_nominal(problem, {}).prior.basis), fitted_modes(problem.system)


def test_modes_are_added_that_the_readings_show(tmp_path: Path) -> None:
    precise, least = modes(tmp_path, STRING, 0.02)
    assert precise > least
    # Noise hides what is left out, and damping removes it.
    assert modes(tmp_path, STRING, 0.3) == (least, least)
    assert modes(tmp_path, DAMPED, 0.02)[0] < precise


def test_a_stated_number_of_modes_is_kept(tmp_path: Path) -> None:
    assert modes(tmp_path, STRING, 0.001, ", modes: 7") == (7, 7)
