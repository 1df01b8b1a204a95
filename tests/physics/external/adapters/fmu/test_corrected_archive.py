"""The FMU of a corrected model, run by FMPy, does what dashred's corrected simulator does."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest
import torch

from dashred.config import load_config
from dashred.physics.backends.input_signals import InputSignals
from dashred.physics.external.adapters.fmu.corrected.archive import write_fmu
from dashred.physics.external.adapters.fmu.corrected.library import Correction, NotPossibleError
from dashred.physics.external.program import describe_fmu
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from tests.physics.external.adapters.fmu.build import build

TEXT = """
system:
  title: Oscillator
  fields: {v: velocity, x: place}
  parameters: {k: 3.0, c: 0.2, q: 0.4}
  inputs: {f: force, g: gust}
  simulator: {fmu: mine.fmu, variables: {v: body.v}}
  equations: {v: LAW}
  start: {x: 1.2, v: 0}
  integrator: {dt: 0.01}
"""
# It reads states, an input and a parameter of the FMU, a parameter that it does not have, and t.
LAW = "-0.3*v*abs(v) - q*k*sin(x) + 0.2*f*x + 0.1*sech(t)"
FORCE, END = 0.5, 4.0


def declared(folder: Path, path: Path, law: str = LAW, dt: float = 0.01) -> System:
    """Return a system whose law is among its equations, with a constant force."""
    text = TEXT.replace("LAW", law).replace("mine.fmu", path.name).replace("0.01}", f"{dt}}}")
    # What only the law reads need not be in the FMU; all else must.
    for name, stated in (("g", ", g: gust"), ("q", ", q: 0.4")):
        text = text if f"{name}*" in law else text.replace(stated, "")
    (folder / "mine.yaml").write_text(text)
    words = [f"conf={folder / 'mine.yaml'}", "recording.path=my.csv", f"trust={path}"]
    config = load_config(words, entry="test")
    signals = InputSignals(np.zeros(1), {"f": np.array([FORCE])})
    return System(config.system, config.where, signals)


def corrected(system: System, folder: Path, told: str = "Corrected.") -> Path:
    description = describe_fmu(system.config, "here")
    law = {name: system.equations[name] for name in system.fields}
    path = folder / "corrected.fmu"
    write_fmu(path, description, Correction(law, system.config.parameters, system.dt), told)
    return path


def run_by_fmpy(path: Path, **over: Any) -> Any:
    import fmpy

    force = np.array([(0, FORCE), (END, FORCE)], dtype=[("t", float), ("f", float)])
    given: dict[str, Any] = {"stop_time": END, "output_interval": 0.1, "relative_tolerance": 1e-10}
    given |= {"input": force, "output": ["body.v", "x", "der(body.v)"], "start_values": {"x": 1.2}}
    return fmpy.simulate_fmu(str(path), **given | over)


def run_by_dashred(system: System) -> np.ndarray:
    start = torch.tensor([[0, 1.2]], dtype=torch.float64)
    times = torch.linspace(0, END, 41, dtype=torch.float64)
    return simulate(system, start, times)[0].numpy()


@pytest.mark.parametrize("version", [2, 3])
def test_it_does_what_the_corrected_simulator_does(tmp_path: Path, version: int) -> None:
    path = build(tmp_path, version)
    systems = [declared(tmp_path, path, dt=dt) for dt in (0.02, 0.01)]
    # The description of the test FMU of FMI 3 has no time, which a valid one has.
    found = run_by_fmpy(corrected(systems[0], tmp_path), validate=version == 2)
    states = np.stack([found["body.v"], found["x"]], axis=1)
    first, second = (np.abs(run_by_dashred(system) - states).max() for system in systems)
    # What is left is the error of splitting, of second order.
    assert second < 1e-4 and 3.8 < first / second < 4.2
    v, x, t = *states.T, found["time"]
    law = -0.3 * v * abs(v) - 0.4 * 3 * np.sin(x) + 0.2 * FORCE * x + 0.1 / np.cosh(t)
    np.testing.assert_allclose(found["der(body.v)"], -3 * x - 0.2 * v + FORCE + law, atol=1e-9)


def test_co_simulation_is_split_as_in_the_simulator(tmp_path: Path) -> None:
    path = build(tmp_path, 2, kinds="CoSimulation")
    system = declared(tmp_path, path, dt=0.05)
    found = run_by_fmpy(corrected(system, tmp_path))
    states = np.stack([found["body.v"], found["x"]], axis=1)
    np.testing.assert_allclose(states, run_by_dashred(system), atol=1e-9)


def test_parameters_can_be_changed_in_the_other_tool(tmp_path: Path) -> None:
    path = corrected(declared(tmp_path, build(tmp_path, 2), "k*x"), tmp_path)
    # The law takes the spring away, whatever its stiffness is.
    for k in (1.0, 9.0):
        start = {"x": 1.2, "k": k, "c": 0.0}
        found = run_by_fmpy(path, start_values=start)
        np.testing.assert_allclose(found["body.v"], FORCE * found["time"], atol=1e-8)


def test_its_events_are_those_of_the_original(tmp_path: Path) -> None:
    """Beside a law that holds it up, the body bounces at x = -0.5: v becomes -0.7 v."""
    system = declared(tmp_path, build(tmp_path, 2, events=1), "k*x + c*v")
    start = {"x": -0.3, "body.v": -1.0}
    found = run_by_fmpy(corrected(system, tmp_path), input=None, start_values=start, stop_time=1)
    np.testing.assert_allclose(found["x"][-1], -0.5 + 0.7 * 0.8, atol=1e-6)


def test_its_description_tells_what_it_is(tmp_path: Path) -> None:
    import fmpy

    original = build(tmp_path, 2)
    with ZipFile(original, "a") as archive:
        archive.writestr("binaries/win64/oscillator.dll", b"")
        archive.writestr("sources/all.c", b"")
        archive.writestr("resources/table.txt", b"1 2")
    system = declared(tmp_path, original)
    path = corrected(system, tmp_path, "Drag is added, <-0.3 v²>.")
    before, after = map(fmpy.read_model_description, (str(original), str(path)))
    assert after.modelName == "oscillator corrected" and after.guid != before.guid
    assert after.description == "Drag is added, <-0.3 v²>."
    assert after.coSimulation is None
    assert after.modelExchange.modelIdentifier == "oscillator_corrected"
    pairs = zip(before.modelVariables, after.modelVariables, strict=True)
    starts = {a.name: (b.start, a.start) for b, a in pairs if a.start != b.start}
    assert starts == {"k": ("4", "3.0"), "c": ("0.1", "0.2")}
    assert fmpy.supported_platforms(str(path)) == [fmpy.platform]
    with ZipFile(path) as archive:
        assert archive.read("resources/table.txt") == b"1 2"
        assert b"law" in archive.read("documentation/corrected.c")
    once = path.read_bytes()
    assert corrected(system, tmp_path, "Drag is added, <-0.3 v²>.").read_bytes() == once


def test_it_can_be_corrected_again(tmp_path: Path) -> None:
    first = corrected(declared(tmp_path, build(tmp_path, 2), "k*x"), tmp_path)
    first = first.rename(tmp_path / "first.fmu")
    found = run_by_fmpy(corrected(declared(tmp_path, first, "c*v - f"), tmp_path))
    np.testing.assert_allclose(found["x"], 1.2, atol=1e-8)


def test_what_cannot_be_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    system = declared(tmp_path, build(tmp_path, 2), "-0.3*g*v")
    with pytest.raises(
        NotPossibleError, match="law reads g, which is not a real variable of the FMU"
    ):
        corrected(system, tmp_path)
    system = declared(tmp_path, build(tmp_path, 3, kinds="CoSimulation"))
    with pytest.raises(NotPossibleError, match=r"for co-simulation .* with FMI 2 only"):
        corrected(system, tmp_path)
    system = declared(tmp_path, build(tmp_path, 2))
    monkeypatch.setattr(shutil, "which", lambda _: None)
    with pytest.raises(NotPossibleError, match="there is no C compiler"):
        corrected(system, tmp_path)
    assert not (tmp_path / "corrected.fmu").exists()
