"""A whole run in which the simulator is a function on scattered nodes, as in the documentation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import xarray as xr
import yaml
from scipy.linalg import expm

from dashred.config import load_config
from dashred.physics.grids.stencils import local_weights
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from tests.conftest import CHECKOUT, Run
from tests.documents import snippets
from tests.physics.grids.test_stencils import scattered
from tests.pipeline.whole_runs.test_episodes_run import SMALL, findings_of

pytestmark = pytest.mark.slow

PAGE = CHECKOUT / "docs" / "external-simulators.md"
REACTION, SIGMA = -0.4, 0.01
NODES = scattered(64, 2)
SENSORS = np.random.default_rng(2).uniform(0.05, 0.95, (8, 2))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the program, its nodes and a recording."""
    [program] = [text for text in snippets(PAGE, "python") if "Delaunay" in text]
    [system] = [text for text in snippets(PAGE, "yaml") if "nodes:" in text]
    monkeypatch.chdir(tmp_path)
    np.savetxt("plate.csv", NODES, delimiter=",", header="x,y", comments="")
    Path("plate.py").write_text(program)
    Path("plate.yaml").write_text(
        f"{system}recording: {{path: plate_recording.csv, sensors: sensors.csv}}\n"
        f"{SMALL}budget: 1000\n"
    )
    recorded(program)
    return tmp_path


def recorded(program: str) -> None:
    """Write readings of the plate with a reaction, by one exponential of both."""
    scope: dict[str, Any] = {}
    exec(program, scope)
    matrix = 0.03 * scope["stiffness"] / scope["mass"][:, None] - REACTION * np.eye(len(NODES))
    step, (x, y) = expm(-0.1 * matrix), NODES.T
    state = 1 + 1.05 * np.exp(-8 * (x**2 + y**2)) + 0.05 * np.cos(2 * x)
    [read] = local_weights(NODES, SENSORS, [(0, 0)])
    rng, names = np.random.default_rng(0), [f"s{i}" for i in range(len(SENSORS))]
    rows = [",".join(["time", *names])]
    for k in range(31):
        noisy = read @ state + SIGMA * rng.standard_normal(len(SENSORS))
        rows.append(",".join(f"{value:.7g}" for value in (0.1 * k, *noisy)))
        state = step @ state
    Path("plate_recording.csv").write_text("\n".join(rows) + "\n")
    places = [f"{n},T,{a:.7g},{b:.7g},{SIGMA}" for n, (a, b) in zip(names, SENSORS, strict=True)]
    Path("sensors.csv").write_text("\n".join(["name,field,x,y,std", *places]) + "\n")


def test_a_reaction_that_a_program_on_nodes_lacks(train: Run, folder: Path) -> None:
    ended = train(f"conf={folder / 'plate.yaml'}", "trust=plate.step")
    found = findings_of(ended)
    assert found["verdict"] == "missing-term"
    [term] = found["terms"]
    assert (term["equation"], term["term"]) == ("T", "T")
    assert term["coefficient"] == pytest.approx(REACTION, abs=0.02)
    assert term["ci95"][0] < REACTION < term["ci95"][1]
    corrected = yaml.safe_load(ended.read("corrected.yaml"))["system"]
    assert corrected["nodes"] == str(folder / "plate.csv")
    assert "axes" not in corrected
    assert list(corrected["equations"]) == ["T"]
    with xr.open_dataset(ended.output / "estimates.nc", engine="h5netcdf") as estimates:
        assert estimates["T"].dims == ("method", "time", "node")
        np.testing.assert_allclose(estimates["y"], NODES[:, 1])
    # The corrected simulator runs, and decays as the recording does.
    path = ended.output / "corrected.yaml"
    words = [f"conf={path}", "recording.path=plate_recording.csv", "trust=plate.step"]
    config = load_config([*words, "recording.sensors=sensors.csv"], entry="test")
    system = System(config.system, config.where)
    even = torch.ones((1, 1, len(NODES)), dtype=torch.float64)
    last = simulate(system, even, torch.tensor([0.0, 1.0], dtype=torch.float64))[0, -1]
    torch.testing.assert_close(last, np.exp(term["coefficient"]) * even[0], rtol=1e-4, atol=0)
