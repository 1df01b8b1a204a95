"""Snapshots in place of a simulator: Burgers' equation without the drag of the real one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import xarray as xr
from torch import Tensor

from dashred.config import Axis, Integrator, load_config
from dashred.config import System as Declared
from dashred.core.errors import InputError
from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from dashred.pipeline.check import command
from dashred.pipeline.simulation import ensemble_memory
from dashred.pipeline.snapshots.mismatch import ErrorComparison, Mismatch

CONFIG = """\
system:
  title: Burgers
  axes: {x: {length: 2*pi, points: 24}}
  fields: {u: velocity}
  snapshots: runs.nc
library: {u: [u, u**2, "d(u, x)", "d(u, x, 2)"]}
recording: {path: real.csv, sensors: sensors.csv}
splits: {sensors: {validate: 2, test: 3, extra: 2}}
shred: {lags: 6, latent: 12, decoder: [24], modes: 8, epochs: 12, steps: 16, batch: 16}
assimilation: {epochs: 40, patience: 40, batch: 16, rate: 5e-3, width: 16}
latent_sindy: {steps: [1, 2], bootstraps: 3, begins: 4, every: 40}
threads: 1
"""
BURGERS = "-d(u**2/2, x) + 0.2*lap(u)"
TIMES = torch.arange(0, 5.01, 0.1).double()
NOISE = 0.01


def burgers(equation: str) -> System:
    integrator = Integrator(None, 0.05, False, "spectral", 1e-9, 1e-9)
    axes = {"x": Axis(2 * np.pi, 24)}
    declared = Declared(
        title="Burgers", axes=axes, fields={"u": "velocity"}, integrator=integrator,
        equations={"u": equation}, start={"u": 0},
    )  # fmt: skip
    return System(declared, lambda key: key)


def starts(count: int, rng: np.random.Generator) -> Tensor:
    x = 2 * np.pi * torch.arange(24).double() / 24
    z = torch.from_numpy(rng.standard_normal((count, 4, 1)))
    waves = (0.5 + 0.1 * z[:, 1]) * torch.sin(x) + 0.15 * z[:, 2] * torch.cos(x)
    return (1 + 0.3 * z[:, 0] + waves + 0.1 * z[:, 3] * torch.sin(2 * x))[:, None]


def record(path: Path, equation: str, rng: np.random.Generator) -> None:
    """Write what twelve sensors read of one run under an equation."""
    system = burgers(equation)
    [states] = simulate(system, starts(1, rng), TIMES)
    sensors = tuple(Sensor(f"s{i}", "u", (0.2 + 0.52 * i,), NOISE) for i in range(12))
    values = ObservationOperator(sensors, system)(states).numpy()
    values = values + NOISE * rng.standard_normal(values.shape)
    table = np.column_stack([TIMES.numpy(), values])
    header = ",".join(["time", *(sensor.name for sensor in sensors)])
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.8g")
    places = [f"{s.name},u,{s.position[0]},{s.std}" for s in sensors]
    path.with_name("sensors.csv").write_text("\n".join(["name,field,x,std", *places]) + "\n")


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as a user would have it: snapshots, two recordings, a configuration."""
    folder = tmp_path_factory.mktemp("black_box")
    rng = np.random.default_rng(3)
    runs = simulate(burgers(BURGERS), starts(32, rng), TIMES)[:, :, 0]
    x = 2 * np.pi * np.arange(24) / 24
    fields = {"u": (("member", "time", "x"), runs.numpy())}
    data = xr.Dataset(fields, {"time": TIMES.numpy(), "x": x})
    data.to_netcdf(folder / "runs.nc", engine="h5netcdf")
    record(folder / "real.csv", f"{BURGERS} - 0.2*u", rng)
    record(folder / "same.csv", BURGERS, rng)
    (folder / "box.yaml").write_text(CONFIG)
    return folder


@pytest.fixture
def found(given, train, monkeypatch):
    """``found(*words)``: the findings, without figures, and how the command ended."""

    def run(*words: str) -> tuple[dict[str, Any], Any]:
        monkeypatch.setattr("dashred.pipeline.snapshots.black_box_report.report", lambda *_: [])
        ended = train(f"conf={given / 'box.yaml'}", *words)
        assert ended.code == 0, ended.err
        return json.loads(ended.read("findings.json")), ended

    return run


def test_assimilation_corrects_the_field_of_a_simulator_without_equations(found) -> None:
    findings, ended = found()
    # Of a network so small that the drag hardly stands out from what it misses anyhow.
    changes = findings["causes"][0]["changes"]
    assert changes["error"] > max(changes["usual"])
    fit = findings["fit"]
    assert fit["test_sensors"]["dashred"] < 0.8 * fit["test_sensors"]["shred_plain"]
    assert fit["test_sensors"]["dashred"] < fit["test_sensors"]["nearest_snapshots"]
    assert fit["heldout_time"]["dashred"] < fit["heldout_time"]["shred_plain"]
    # What would need a simulator that runs is not there, and the report says so.
    assert findings["terms"] is None and findings["corrected"] is None
    assert fit["test_sensors"]["corrected"] is None and fit["chi2"] is None
    assert not (ended.output / "corrected.yaml").exists()
    first = findings["latent"]["alg1"]["proposals"][0]
    assert first["term"] == "u" and first["coefficient"] == pytest.approx(-0.2, rel=0.5)
    assert findings["latent"]["alg2"]["proposals"]
    assert "Limits of this analysis:" in ended.out
    assert "are untested, and have no intervals" in ended.out
    assert "times smaller" in ended.out
    assert "  nearest snapshots  " in ended.out and "  SHRED, plain  " in ended.out
    assert len(findings["input"]["snapshots_sha256"]) == 64
    assert findings["input"]["config"]["system"]["snapshots"] == "runs.nc"
    with xr.open_dataset(ended.output / "estimates.nc", engine="h5netcdf") as estimates:
        names = ["nearest_snapshots", "shred_plain", "dashred"]
        assert list(estimates["method"].values) == names
        assert estimates.sizes["time"] == len(TIMES)


@pytest.mark.slow
def test_a_recording_of_the_simulation_itself_shows_no_mismatch(found, given) -> None:
    findings, ended = found(f"recording.path={given / 'same.csv'}")
    assert findings["verdict"] == "no-mismatch-seen"
    assert "may still be missing" in ended.out


def test_what_was_cut_short_goes_on_without_training_again(given, train, monkeypatch) -> None:
    words = (f"conf={given / 'box.yaml'}", "shred.epochs=2", "assimilation.epochs=2")
    report = "dashred.pipeline.snapshots.black_box_report.report"
    with monkeypatch.context() as patch:
        patch.setattr(report, lambda *_: [])
        once = train(*words)
    before, fields = once.read("findings.json"), once.read("estimates.nc")
    with monkeypatch.context() as patch:
        patch.setattr(report, interrupted)
        assert train(*words).code == 130
    monkeypatch.setattr(report, lambda *_: [])
    monkeypatch.setattr("dashred.pipeline.networks.training.train_shred", interrupted)
    again = train(*words)
    assert again.code == 0, again.err
    assert (again.read("findings.json"), again.read("estimates.nc")) == (before, fields)
    assert not list(again.root.glob("artifacts/*/checkpoints/*"))


def interrupted(*_: object) -> None:
    raise KeyboardInterrupt


@pytest.mark.slow
def test_the_report_is_drawn_and_says_what_it_cannot_know(given, train) -> None:
    ended = train(f"conf={given / 'box.yaml'}", "shred.epochs=2", "assimilation.epochs=2")
    assert ended.code == 0, ended.err
    page = ended.read("report.html").decode()
    assert "Limits of this analysis" in page
    assert "no law could be fitted to the sensors through it" in page
    assert page.count("<figure") == 4


def test_a_mismatch_is_what_no_run_of_the_simulation_shows() -> None:
    usual = torch.tensor([0.05, 0.06, 0.055, 0.07, 0.05])
    assert ErrorComparison(0.4, usual, {}).beyond
    assert ErrorComparison(0.4, usual, {}).p == pytest.approx(1 / 6)
    assert not ErrorComparison(0.065, usual, {}).beyond
    assert not ErrorComparison(0.08, torch.tensor([0.03, 0.07, 0.05]), {}).beyond
    for states, changes in ((0.4, 0.05), (0.05, 0.4), (0.05, 0.05)):
        either = Mismatch(
            ErrorComparison(states, usual, {}), ErrorComparison(changes, usual, {}), 8
        )
        assert either.seen == (max(states, changes) > 0.1)


REFUSED = {
    "system.equations.u=-u": "system.equations and system.snapshots are both given",
    "system.start.u=1": "system.start and system.snapshots are both given",
    "system.spread.u=0.1": "system.spread and system.snapshots are both given",
    "system.integrator.dt=0.1": "system.integrator.dt needs equations",
    "recording.twin=a": "a twin needs equations",
}


@pytest.mark.parametrize("word", REFUSED)
def test_keys_that_nothing_would_read_are_refused(given, word: str) -> None:
    with pytest.raises(InputError, match=REFUSED[word]) as error:
        load_config([f"conf={given / 'box.yaml'}", word], entry="train")
    assert error.value.where == "command line"


def test_too_few_runs_are_refused(given, train) -> None:
    ended = train(
        f"conf={given / 'box.yaml'}",
        "simulation.members=3",
        "simulation.held_out=1",
        "shred.lags=30",
    )
    assert ended.code == 2
    assert "too few for training" in ended.err
    assert not (ended.output / "findings.json").exists()


def test_a_check_tells_what_there_is_to_learn_from(given, capsys) -> None:
    own = f"conf={given / 'box.yaml'}"
    assert command.main([own]) == 0
    said = capsys.readouterr().out
    assert "32 runs of 51 snapshots at a step of 0.1, cut into" in " ".join(said.split())
    assert "times as much as in the snapshots" in said
    few = ("simulation.members=3", "simulation.held_out=1", "shred.lags=30")
    with pytest.raises(InputError, match="too few for training"):
        command.main([own, *few])


def test_runs_that_stay_on_disk_give_the_same_findings(
    given, train, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = (f"conf={given / 'box.yaml'}", "shred.epochs=2", "assimilation.epochs=2")
    monkeypatch.setattr("dashred.pipeline.snapshots.black_box_report.report", lambda *_: [])
    findings = []
    for copies in (1.0, 1e9):
        monkeypatch.setattr(ensemble_memory, "ENSEMBLE_COPIES", copies)
        ended = train(*words)
        assert ended.code == 0, ended.err
        assert ("read in parts" in ended.out) == (copies > 1)
        findings.append(json.loads(ended.read("findings.json")))
    plain, stored = findings
    assert stored["input"] == plain["input"] and stored["verdict"] == plain["verdict"]
    for name, error in plain["fit"]["test_sensors"].items():
        again = stored["fit"]["test_sensors"][name]
        assert again is None if error is None else again == pytest.approx(error, rel=1e-2)


def test_a_check_tells_where_the_runs_are_kept(given, capsys, monkeypatch) -> None:
    own = f"conf={given / 'box.yaml'}"
    assert command.main([own, "simulation.memory=4 GiB"]) == 0
    assert "of 0.3 MiB is kept in memory" in " ".join(capsys.readouterr().out.split())
    monkeypatch.setattr(ensemble_memory, "ENSEMBLE_COPIES", 1e9)
    assert command.main([own, "simulation.memory=4 GiB"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "may take 4 GiB: the set of runs of 0.3 MiB is kept on disk and read in parts" in said
