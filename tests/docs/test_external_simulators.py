"""The programs in the page on external simulators step as it says."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dashred.config import load_config
from dashred.physics.external.adapters.fmu.corrected.archive import write_fmu
from dashred.physics.external.adapters.fmu.corrected.library import Correction
from dashred.physics.external.program import describe_fmu
from dashred.physics.external.protocol import Program
from dashred.physics.system import System
from tests.conftest import CHECKOUT
from tests.documents import snippets
from tests.physics.external.adapters.fmu.build import build
from tests.physics.grids.test_stencils import scattered

PAGE = CHECKOUT / "docs" / "external-simulators.md"
FUNCTION, NETCDF, TEXT, NODES, FMU = snippets(PAGE, "yaml")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    step, jvp, run, solver, plate, _ = snippets(PAGE, "python")
    (tmp_path / "mypkg.py").write_text(f"{step}\n{jvp}\n{run}")
    (tmp_path / "solver.py").write_text(solver)
    (tmp_path / "plate.py").write_text(plate)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    for module in ("mypkg", "plate"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    return tmp_path


def opened(text: str, name: str) -> tuple[System, Program]:
    Path("mine.yaml").write_text(text)
    words = ["conf=mine.yaml", "recording.path=my.csv", f"trust={name}"]
    config = load_config(words, entry="test")
    system = System(config.system, config.where)
    assert system.program is not None
    return system, system.program


def stepped(system: System, program: Program, state: np.ndarray, dt: float) -> np.ndarray:
    each = np.ones(len(state))
    inputs = dict.fromkeys(system.config.inputs, 0 * each)
    return program.step(state, 0 * each, dt * each, inputs, system.config.parameters)


@pytest.mark.parametrize("name", ["step", "run"])
def test_the_functions_step(name: str) -> None:
    text = FUNCTION.replace("function: mypkg.step", f"function: mypkg.{name}")
    text = text.replace("function: mypkg.run", "run: mypkg.run")
    states = np.array([[1.0, 0.0], [0.5, -1.0]])
    found = stepped(*opened(text, f"mypkg.{name}"), states, 0.05)
    cos, sin = np.cos(0.1), np.sin(0.1)
    exact = states @ np.array([[cos, -2 * sin], [sin / 2, cos]])
    np.testing.assert_allclose(found, exact, atol=1e-3 if name == "step" else 1e-7)


def test_the_function_offers_its_tangents() -> None:
    text = FUNCTION.replace("mypkg.step}", "mypkg.step, keep: false}")
    _, program = opened(text, "mypkg.step")
    assert program.tangent is not None
    states = np.array([[1.0, 0.0, 1.0, 0.0], [0.5, -1.0, 0.0, 1.0]])
    each: dict[str, Any] = {"inputs": {}, "parameters": {"k": 4.0}}
    found = program.tangent.step(states, np.zeros(2), np.full(2, 0.05), **each)
    # The step is linear: a tangent moves as a state does.
    moved = program.step(states[:, 2:], np.zeros(2), np.full(2, 0.05), **each)
    np.testing.assert_allclose(found[:, 2:], moved, atol=1e-12)


def test_the_solver_with_netcdf_steps() -> None:
    system, program = opened(NETCDF.replace("python3", sys.executable), sys.executable)
    x = system.axes[0].spacing * np.arange(32)
    # An analytic solution: u = -2 nu f'/f with the heat kernel f = 2 + exp(-nu t) cos(x).
    states, exact = (
        (0.2 * f * np.sin(x) / (2 + f * np.cos(x)))[None, None] for f in (1, np.exp(-0.1 * 0.05))
    )
    np.testing.assert_allclose(stepped(system, program, states, 0.05), exact, atol=1e-6)


def test_the_solver_with_text_steps(folder: Path) -> None:
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no C compiler")
    [code], [template] = snippets(PAGE, "c"), snippets(PAGE, "jinja")
    (folder / "heat.c").write_text(code)
    (folder / "heat.j2").write_text(template)
    subprocess.run([compiler, "-o", "heat", "heat.c"], check=True)
    system, program = opened(TEXT, "./heat")
    wave = np.cos(np.pi * np.arange(16) / 8)
    # Of differences in space, the wave is a mode with the factor (1 - a h (4/dx²) sin²(…))^20.
    factor = (1 - 0.1 * 0.01 / 20 * 4 * 64 * np.sin(np.pi / 16) ** 2) ** 20
    found = stepped(system, program, 300 + 10 * wave[None, None], 0.01)
    np.testing.assert_allclose(found[0, 0], 300 + 10 * factor * wave, rtol=1e-13)


def test_the_plate_steps(folder: Path) -> None:
    nodes = scattered(150, 2)
    np.savetxt(folder / "plate.csv", nodes, delimiter=",", header="x,y", comments="")
    system, program = opened(NODES, "plate.step")
    assert [axis.name for axis in system.axes] == ["x", "y"]
    # A cosine with zero slope at the sides decays as exp(-kappa pi² t).
    wave = np.cos(np.pi * nodes[:, 0])
    found = stepped(system, program, np.stack([wave, 0 * wave + 2])[:, None], 1.0)[:, 0]
    np.testing.assert_allclose(found[0], np.exp(-0.03 * np.pi**2) * wave, atol=0.01)
    np.testing.assert_allclose(found[1], 2.0, rtol=1e-9)


def test_the_fmu_steps(folder: Path) -> None:
    build(folder, 2).rename("oscillator.fmu")
    found = stepped(*opened(FMU, "oscillator.fmu"), np.array([[1.0, 0.0]]), 0.05)
    w = np.sqrt(4 - 0.05**2)
    exact = np.exp(-0.05 * 0.05) * (np.cos(0.05 * w) + 0.05 / w * np.sin(0.05 * w))
    np.testing.assert_allclose(found[0, 0], exact, atol=1e-9)


def test_the_corrected_fmu_runs(folder: Path) -> None:
    build(folder, 2).rename("oscillator.fmu")
    system, _ = opened(FMU, "oscillator.fmu")
    # It takes the damping away, and half of the spring.
    law = {"x": "0", "v": "c*v + k/2*x"}
    parsed = {name: system.parse(text, f"system.equations.{name}") for name, text in law.items()}
    correction = Correction(parsed, system.config.parameters, system.dt)
    write_fmu(Path("corrected.fmu"), describe_fmu(system.config, ""), correction, "")
    scope: dict[str, Any] = {}
    exec(snippets(PAGE, "python")[-1], scope)
    found = scope["result"]
    np.testing.assert_allclose(found["x"], np.cos(np.sqrt(3.5 / 2) * found["time"]), atol=1e-3)
