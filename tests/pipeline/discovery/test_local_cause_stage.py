"""A source and a term in a region are told without a fit of all candidates."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from dashred.config import load_config
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from tests.pipeline.simulation.conftest import SHORT_RUN

SYSTEM = """
system:
  title: a channel
  axes: {x: {length: 10, points: 48}}
  fields: {c: concentration}
  equations: {c: "-0.5*d(c, x) + 0.08*lap(c) - 0.1*cHIDDEN"}
  start: {c: 0.5 + 0.3*cos(2*pi*x/10)}
  spread: {c: 0.02, length: 2}
  integrator: {dt: 0.05}
"""
REST = (
    """
library: {c: ["1", c, c**2, "d(c, x, 3)"]}
recording: {path: recording.csv, sensors: sensors.csv}
splits: {sensors: {validate: 1, test: 1, extra: 0}}
simulation: {members: 16, held_out: 4, terms: 1}"""
    + SHORT_RUN
)
PLACES = np.linspace(0, 10, 13)[:-1] + 0.3
TIMES = torch.linspace(0, 8, 81, dtype=torch.float64)
NOISE = 0.004
SOURCE = " + 0.3*exp(6*(cos(2*pi*(x - 8.2)/10) - 1))"
REGION = " - 0.25*c*(tanh((x - 3)/0.2) - tanh((x - 6)/0.2))"


def recorded(folder: Path, hidden: str) -> Path:
    """Write the recording of a channel with a hidden part, and return the configuration."""
    twin = "recording: {twin: a, sensors: 1, noise: 0, duration: 4, every: 0.1}\n"
    (folder / "truth.yaml").write_text(SYSTEM.replace("HIDDEN", hidden) + twin, encoding="utf-8")
    config = load_config([f"conf={folder / 'truth.yaml'}"], entry="test")
    system = System(config.system, config.where)
    x = system.grid.coordinates["x"]
    start = (0.51 + 0.29 * torch.cos(2 * torch.pi * x / 10))[None, None]
    states = simulate(system, start, TIMES)[0, :, 0]
    exact = np.stack([np.interp(PLACES, x.numpy(), row, period=10.0) for row in states.numpy()])
    readings = exact + NOISE * np.random.default_rng(1).standard_normal(exact.shape)
    names = [f"s{i}" for i in range(len(PLACES))]
    table = np.column_stack([TIMES.numpy(), readings])
    header = ",".join(["time", *names])
    np.savetxt(folder / "recording.csv", table, delimiter=",", header=header, comments="")
    rows = [f"{name},c,{place}" for name, place in zip(names, PLACES, strict=True)]
    (folder / "sensors.csv").write_text("\n".join(["name,field,x", *rows]) + "\n", encoding="utf-8")
    (folder / "channel.yaml").write_text(SYSTEM.replace("HIDDEN", "") + REST, encoding="utf-8")
    return folder / "channel.yaml"


def findings_without_a_horizon(folder: Path, train, hidden: str) -> dict[str, Any]:
    """Return the findings of a run, which must not have grown a horizon."""
    config = recorded(folder, hidden)
    ended = train(f"conf={config}", f"recording.path={folder / 'recording.csv'}")
    assert ended.code == 0, ended.err
    assert "grow the horizon" not in ended.out
    return json.loads(ended.read("findings.json"))


@pytest.mark.slow
def test_a_source(tmp_path: Path, train) -> None:
    findings = findings_without_a_horizon(tmp_path, train, SOURCE)
    assert findings["verdict"] == "outside-library"
    source = findings["where"]["source"]
    assert source["equation"] == "c" and source["period"] is None
    assert source["place"][0] == pytest.approx(8.2, abs=0.15)
    assert findings["where"]["forcing"]["peak"][0] == pytest.approx(8.2, abs=0.6)


@pytest.mark.slow
def test_a_term_in_a_region(tmp_path: Path, train) -> None:
    findings = findings_without_a_horizon(tmp_path, train, REGION)
    assert findings["verdict"] == "missing-term"
    [term] = findings["terms"]
    assert (term["equation"], term["term"]) == ("c", "c")
    assert term["coefficient"] == pytest.approx(-0.5, rel=0.1)
    [region] = term["region"]
    assert (region["axis"], region["from"], region["to"]) == (
        "x",
        pytest.approx(3, abs=0.2),
        pytest.approx(6, abs=0.2),
    )
