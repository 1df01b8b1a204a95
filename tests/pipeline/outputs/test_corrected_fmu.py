"""``corrected.fmu``: written, run, and told of, or the reason why there is none."""

from __future__ import annotations

import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp

from dashred.config import load_config
from dashred.inference.fit.law import Law
from dashred.inference.forward.candidates import Candidate
from dashred.inference.results.corrected_system import build_corrected_system
from dashred.physics.backends.input_signals import InputSignals
from dashred.physics.external.adapters.fmu.corrected.archive import write_fmu
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from dashred.pipeline.outputs import corrected_fmu
from dashred.pipeline.outputs.corrected_config import write_corrected
from tests import laws
from tests.physics.external.adapters.fmu.build import build
from tests.pipeline.whole_runs.test_episodes_run import SMALL, findings_of

TEXT = """
system:
  title: Oscillator
  fields: {x: place, v: velocity}
  parameters: {k: 4.0, c: 0.1}
  inputs: {f: f}
  simulator: {fmu: oscillator.fmu, variables: {v: body.v}}
  start: {x: 1, v: 0}
  spread: {x: 0.1, v: 0.1}
  integrator: {dt: 0.05}
"""
TIMES = 0.1 * np.arange(120, dtype=np.float64)
FORCE = 0.5 * np.sin(0.7 * TIMES) + 0.4 * np.sin(1.9 * TIMES)


def loaded(path: Path) -> tuple[Any, System]:
    words = [f"conf={path}", "recording.path=my.csv", f"trust={path.parent / 'oscillator.fmu'}"]
    config = load_config(words, entry="train")
    return config, System(
        config.system, config.where, InputSignals(TIMES, {"f": np.asarray(FORCE, float)})
    )


def declared(folder: Path, **over: Any) -> tuple[Any, System]:
    build(folder, 2, **over).rename(folder / "oscillator.fmu")
    (folder / "mine.yaml").write_text(TEXT)
    return loaded(folder / "mine.yaml")


def found_law(system: System) -> Law:
    found = [laws.term(system, "v", "v*abs(v)"), laws.term(system, "v", "f*x")]
    return laws.law(found, [-0.6, 0.2])


def runs(system: System) -> Any:
    times = torch.from_numpy(TIMES[:40])
    states = simulate(system, torch.tensor([[1.0, 0.0]], dtype=torch.float64), times)[0]
    return SimpleNamespace(states={"corrected": states}, times=times, recorded=len(times))


def written(folder: Path, system: System, law: Law) -> str:
    problem: Any = SimpleNamespace(system=system)
    trajectories = runs(build_corrected_system(system, law))
    path = folder / corrected_fmu.NAME
    return corrected_fmu.write_corrected_fmu(path, problem, law, trajectories, "It is so.")


@pytest.mark.parametrize("kinds", ["ModelExchange", "CoSimulation"])
def test_it_is_run_before_it_is_told_of(
    tmp_path: Path, kinds: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    fmpy = pytest.importorskip("fmpy")
    _, system = declared(tmp_path, kinds=kinds)
    path, law = tmp_path / corrected_fmu.NAME, found_law(system)
    assert "is an FMU of the corrected simulator" in written(tmp_path, system, law)
    told = fmpy.read_model_description(str(path), validate=False).description
    assert told.startswith("Corrected by dashred. The simulation leaves out")
    assert told.endswith("It is so.")

    def write_another(path: Path, description: Any, correction: Any, told: str) -> None:
        other = build_corrected_system(system, laws.law(law.candidates, [-0.6, 0.25]))
        correction.law["v"] = other.equations["v"]
        own(path, description, correction, told)

    own = write_fmu
    monkeypatch.setattr(corrected_fmu, "write_fmu", write_another)
    said = written(tmp_path, system, law)
    assert said.startswith("There is no corrected.fmu: in a test run it did not do what")
    assert not path.exists()


@pytest.mark.parametrize("kinds", ["ModelExchange", "CoSimulation"])
def test_another_value_of_a_parameter_needs_no_terms(tmp_path: Path, kinds: str) -> None:
    fmpy = pytest.importorskip("fmpy")
    _, system = declared(tmp_path, kinds=kinds)
    stiffer = laws.law([Candidate("k", None, (), 1.0, in_program=True)], [0.5])
    assert "is an FMU of the corrected simulator" in written(tmp_path, system, stiffer)
    options = {"stop_time": 2.4, "step_size": 0.05, "output": ["x"], "solver": "CVode"}
    options["relative_tolerance"] = 1e-8
    found = fmpy.simulate_fmu(str(tmp_path / corrected_fmu.NAME), **options)
    original = str(tmp_path / "oscillator.fmu")
    expected = fmpy.simulate_fmu(original, start_values={"k": 4.5}, **options)
    np.testing.assert_allclose(found["x"][-1], expected["x"][-1], atol=1e-3)
    plain = fmpy.simulate_fmu(original, **options)
    assert abs(plain["x"][-1] - expected["x"][-1]) > 0.02


def test_why_there_is_none_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, system = declared(tmp_path)
    assert written(tmp_path, system, laws.law()) == ""
    monkeypatch.setattr(shutil, "which", lambda _: None)
    said = "There is no corrected.fmu: there is no C compiler (cc or gcc)."
    assert written(tmp_path, system, found_law(system)) == said
    assert not (tmp_path / corrected_fmu.NAME).exists()
    other: Any = SimpleNamespace(system=laws.declared(tmp_path))
    path = tmp_path / corrected_fmu.NAME
    assert corrected_fmu.write_corrected_fmu(path, other, laws.law(), other, "") == ""


def test_the_configuration_runs_the_same_fmu_from_another_folder(tmp_path: Path) -> None:
    config, system = declared(tmp_path)
    (tmp_path / "output").mkdir()
    path, law = tmp_path / "output" / "corrected.yaml", found_law(system)
    write_corrected(path, config, system, law, "abc")
    config = load_config(
        [f"conf={path}", "recording.path=my.csv", f"trust={tmp_path / 'oscillator.fmu'}"],
        entry="train",
    )
    again = System(config.system, config.where, system.input_signals)
    assert config.system.equations.keys() == {"v"}
    expected = runs(build_corrected_system(system, law)).states["corrected"]
    # The force, which the law reads, drives the FMU too.
    torch.testing.assert_close(runs(again).states["corrected"], expected)


@pytest.mark.slow
def test_a_run_writes_it_and_it_follows_the_recording(train: Any, tmp_path: Path) -> None:
    fmpy = pytest.importorskip("fmpy")
    declared(tmp_path)
    rng = np.random.default_rng(1)

    def tendency(t: float, u: np.ndarray) -> list[float]:
        force = np.interp(t, TIMES, FORCE)
        return [u[1], -4 * u[0] - 0.1 * u[1] + force - 0.6 * u[1] * abs(u[1])]

    given: dict[str, Any] = {"t_eval": TIMES, "rtol": 1e-9, "atol": 1e-9, "max_step": 0.05}
    x, v = solve_ivp(tendency, (0, TIMES[-1]), [1, 0], **given).y
    noise = 0.01 * rng.standard_normal((2, len(TIMES)))
    table = np.column_stack([TIMES, x + noise[0], v + noise[1], FORCE])
    np.savetxt(tmp_path / "my.csv", table, delimiter=",", header="time,x,v,f", comments="")
    library = "library: {x: [], v: [v*abs(v), v**3, x**3]}\n"
    (tmp_path / "mine.yaml").write_text(TEXT + library + SMALL)
    words = f"conf={tmp_path / 'mine.yaml'}", f"recording.path={tmp_path / 'my.csv'}"
    ended = train(*words, f"trust={tmp_path / 'oscillator.fmu'}")
    [term] = findings_of(ended)["terms"]
    assert term["term"] == "v*abs(v)" and term["coefficient"] == pytest.approx(-0.6, abs=0.02)
    assert b"# corrected.fmu is an FMU of the corrected simulator" in ended.read("corrected.yaml")
    force = np.array([*zip(TIMES, FORCE, strict=True)], dtype=[("t", float), ("f", float)])
    run = fmpy.simulate_fmu(
        str(ended.output / "corrected.fmu"),
        stop_time=TIMES[-1],
        output_interval=0.01,
        relative_tolerance=1e-8,
        input=force,
        output=["x"],
    )
    assert np.abs(np.interp(TIMES, run["time"], run["x"]) - x).max() < 0.02
