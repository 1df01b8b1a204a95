"""The configurations and the Python that the documents show are taken as they are printed."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from dashred.config import load_config
from dashred.data.io.reader import read_recording
from dashred.physics.system import System
from dashred.pipeline.check import command
from tests.conftest import CHECKOUT
from tests.documents import snippets

DOCS = CHECKOUT / "docs"
POINTS, SAMPLES, MEMBERS = 24, 120, 6


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def written(path: Path, columns: dict[str, np.ndarray]) -> None:
    """Write a CSV."""
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, rows, "%.6f", ",", header=",".join(columns), comments="")


def test_the_netcdf_that_is_described_is_read() -> None:
    [program] = snippets(DOCS / "own-system.md", "python")
    exec(program, {})
    config = load_config(["conf=pendulum"], entry="test")
    recording = read_recording("swing.nc", None, System(config.system, config.where))
    assert [(s.name, s.reads, s.std) for s in recording.sensors] == [
        ("angle", "theta", 0.01),
        ("speed", "omega", None),
    ]


def test_a_system_with_an_input_is_checked(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    [text, held] = [text for text in snippets(DOCS / "own-system.md", "yaml") if "inputs:" in text]
    Path("capacitor.yaml").write_text(text)
    begin = text.index("  inputs:")
    end = text.index("\n", begin)
    Path("held.yaml").write_text(text[:begin] + held.rstrip("\n") + text[end:])
    t = 0.05 * np.arange(200)
    # q' = (1 - q/C)/R from an empty capacitor: q = C (1 - exp(-t/RC)), R C = 1
    written(folder / "capacitor.csv", {"time": t, "q": (1 - np.exp(-t)) / 2, "voltage": t**0})
    assert command.main(["conf=capacitor.yaml"]) == 0
    said = capsys.readouterr().out
    assert "200 samples of 1 sensor" in said and "The simulation is resolved" in said
    assert "x " not in {line.strip()[:2] for line in said.splitlines()}
    assert command.main(["conf=held.yaml"]) == 0
    said = capsys.readouterr().out
    assert "x " not in {line.strip()[:2] for line in said.splitlines()}


def test_snapshots_that_are_described_are_checked(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = DOCS / "black-box.md"
    x, t = np.arange(POINTS) * 2 * math.pi / POINTS, 0.05 * np.arange(SAMPLES)
    phases = np.arange(MEMBERS)[:, None, None]
    u = np.exp(-0.1 * t)[:, None] * np.sin(x - t[:, None] + phases)
    exec(snippets(page, "python")[0], {"xr": xr, "u": u, "t": t, "x": x})
    Path("burgers.yaml").write_text(snippets(page, "yaml")[0])
    places = {f"s{j}": x[3 * j] for j in range(8)}
    Path("sensors.csv").write_text(
        "\n".join(["name,field,x", *(f"{name},u,{at:.6f}" for name, at in places.items()), ""])
    )
    readings = {name: np.exp(-0.1 * t) * np.sin(at - t) for name, at in places.items()}
    written(folder / "real.csv", {"time": t} | readings)
    assert command.main(["conf=burgers.yaml"]) == 0
    said = capsys.readouterr().out
    assert f"{SAMPLES} samples of 8 sensors" in said and f"{MEMBERS} runs" in said
    assert re.search(r"About \d+ s", said)


def test_a_parameter_with_a_spread_is_read() -> None:
    [parameters] = [
        text for text in snippets(DOCS / "own-system.md", "yaml") if "spread: 1" in text
    ]
    Path("tank.yaml").write_text(
        "system:\n  title: tank\n  fields: {h: level}\n"
        f"{parameters}"
        "  equations: {h: m - h/R}\n  start: {h: 1}\n  integrator: {dt: 0.1}\n"
    )
    system = load_config(["conf=tank.yaml", "recording.path=tank.csv"], entry="test").system
    assert system.parameters == {"R": 2.7, "m": 0.4}
    assert system.parameter_spread == {"R": 1.0}
