"""The largest memory of a run with an ensemble in memory and on disk, in processes of their own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import CHECKOUT

# Diffusion in a plane, in one step from sample to sample: 96 members of 24 samples of 128² values.
CONFIG = """\
system:
  title: Diffusion
  axes: {x: {length: 2*pi, points: 128}, y: {length: 2*pi, points: 128}}
  fields: {u: temperature}
  equations: {u: "0.05*lap(u) - d(u, x)"}
  start: {u: sin(x)*cos(y)}
  spread: {u: 0.3, length: 1.0, modes: 30}
  integrator: {dt: 0.1}
library: {u: [u, "d(u, y)"]}
recording: {path: recording.csv, sensors: sensors.csv}
simulation: {members: 96, held_out: 16, terms: 1}
shred: {lags: 5, modes: 16, epochs: 2, steps: 10}
threads: 1
budget: 1e5
"""
SAMPLES, SENSORS = 30, 12


def configured(folder: Path) -> Path:
    rng = np.random.default_rng(0)
    names = [f"s{i}" for i in range(SENSORS)]
    table = np.column_stack([0.1 * np.arange(SAMPLES), rng.standard_normal((SAMPLES, SENSORS))])
    header = ",".join(["time", *names])
    np.savetxt(folder / "recording.csv", table, delimiter=",", header=header, comments="")
    places = rng.uniform(0, 6, (SENSORS, 2))
    rows = [f"{name},u,{x:.3f},{y:.3f}" for name, (x, y) in zip(names, places, strict=True)]
    (folder / "sensors.csv").write_text("\n".join(["name,field,x,y", *rows]) + "\n")
    (folder / "plane.yaml").write_text(CONFIG)
    return folder / "plane.yaml"


def measured(config: Path, limit: str) -> dict[str, Any]:
    ended = subprocess.run(
        [
            *(sys.executable, "-m", "tests.pipeline.simulation.peak_memory", str(config)),
            *(f"simulation.memory={limit}", f"output={config.parent / 'output'}"),
        ],
        cwd=CHECKOUT,
        env=os.environ | {"PYTHONPATH": str(CHECKOUT)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert ended.returncode == 0, ended.stderr
    found: dict[str, Any] = json.loads(ended.stdout.splitlines()[-1])
    return found


@pytest.mark.slow
def test_a_run_keeps_to_its_memory(tmp_path: Path) -> None:
    config = configured(tmp_path)
    kept, stored = measured(config, "100 GiB"), measured(config, "1.7 GiB")
    assert kept["in_memory"] and not stored["in_memory"]
    assert stored["error"] == pytest.approx(kept["error"], rel=1e-3)
    # What is planned is an upper bound, and not a wild one.
    for found in (kept, stored):
        assert found["peak"] <= found["planned"] < 2 * found["peak"]
    assert stored["peak"] <= 1.7 * 2**30
    assert kept["peak"] - stored["peak"] > kept["ensemble"]
