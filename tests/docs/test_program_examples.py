"""The programs in ``docs/examples`` step as their pages say, and their recordings are written."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dashred.config import load_config
from dashred.physics.external.protocol import Program
from dashred.physics.system import System
from tests.conftest import CHECKOUT
from tests.documents import snippets


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(CHECKOUT / "docs" / "examples", tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def test_the_page_shows_the_files() -> None:
    page = CHECKOUT / "docs" / "program-examples.md"
    [code], [text] = snippets(page, "python"), snippets(page, "yaml")
    written = re.sub(r'    """.*"""\n', "", Path("burgers.py").read_text(encoding="utf-8"))
    assert code in written
    assert Path("channel.yaml").read_text(encoding="utf-8").startswith(text)


def opened(path: str, name: str) -> tuple[System, Program]:
    config = load_config([f"conf={path}", f"trust={name}"], entry="test")
    system = System(config.system, config.where)
    assert system.program is not None
    return system, system.program


def stepped(system: System, program: Program, state: np.ndarray, dt: float) -> np.ndarray:
    each = np.ones(len(state))
    return program.step(state, 0 * each, dt * each, {}, system.config.parameters)


def test_the_channel_steps_as_it_records(folder: Path) -> None:
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None or shutil.which("nc-config") is None:
        pytest.skip("there is no C compiler, or no NetCDF for it")
    flags = ["-DWITH_NETCDF", "-lnetcdf"]
    for name, extra in {"channel": flags, "record": []}.items():
        words = [compiler, "-O2", "channel.c", "-o", name, *extra, "-lm"]
        subprocess.run(words, check=True)
    printed = subprocess.run(
        ["./record", "0", "0", "0", "1", "0"], capture_output=True, text=True, check=True
    ).stdout
    states = np.loadtxt(printed.splitlines()).reshape(61, 1, 32, 17)
    system, program = opened("channel.yaml", "./channel")
    # The axis y has a mirror image, which no program sees.
    mirrored = np.concatenate([states, states[..., -2:0:-1]], axis=-1)
    found = stepped(system, program, mirrored[[0, 30]], 0.1)
    np.testing.assert_allclose(found, mirrored[[1, 31]], atol=1e-9)
    subprocess.run([sys.executable, "channel_recording.py"], input=printed, text=True, check=True)
    readings = np.loadtxt("channel.csv", delimiter=",", skiprows=1)
    assert readings.shape == (61, 19)
    np.testing.assert_allclose(readings[:, 1], states[:, 0, 1, 0], atol=0.02)


def test_burgers_steps() -> None:
    pytest.importorskip("exponax")
    system, program = opened("burgers.yaml", "burgers.step")
    x = 2 * np.pi * np.arange(64) / 64
    # An analytic solution: u = -2 nu f'/f with the heat kernel f = 2 + exp(-nu t) cos(x).
    states, exact = (
        (0.1 * f * np.sin(x) / (2 + f * np.cos(x)))[None, None] for f in (1, np.exp(-0.05 * 0.1))
    )
    np.testing.assert_allclose(stepped(system, program, states, 0.1), exact, atol=1e-6)
    assert program.rounding < 1e-6


def test_the_recording_of_burgers_is_written() -> None:
    subprocess.run([sys.executable, "burgers_recording.py"], check=True)
    readings = np.loadtxt("burgers.csv", delimiter=",", skiprows=1)
    assert readings.shape == (81, 18)
    # Drag and viscosity slow it down.
    assert readings[-1, 1:].mean() == pytest.approx(np.exp(-0.3 * 8), abs=0.05)
