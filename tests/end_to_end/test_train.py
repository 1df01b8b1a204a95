"""Whole runs: what they leave, what they repeat, and when they refuse to find anything."""

from __future__ import annotations

import json
import re
import sqlite3
from pathlib import Path
from typing import Any

import pytest

from dashred.pipeline.run.run_tags import headline_metrics, short_verdict
from dashred.reporting.figures.style import new_figure, save_figure

CHECKOUT = Path(__file__).resolve().parents[2]
PENDULUM = CHECKOUT.parent / "shared" / "data" / "pendulum_single" / "recording.csv"
FIGURES = {
    "coefficients.png",
    "evidence.png",
    "forecast.png",
    "learning.png",
    "sensor_traces.png",
    "sparsity.png",
    "verification.png",
    "where.png",
}
# Work of the quick twin experiment, which dashred.core.work counts.
WORK = {
    "trajectory steps": 30_466,
    "trajectory values": 980_392,
    "column steps": 111_237,
    "column values": 3_559_536,
    "transforms": 1_600_355,
    "transform values": 51_256_176,
}
COARSE = ("system.parameters.nu=0.04", "system.axes.x.points=24", "system.integrator.dt=0.02")


def test_a_twin_experiment_leaves_all_its_files(twin_run) -> None:
    left = {path.name for path in twin_run.output.iterdir()}
    assert left == FIGURES | {
        "corrected.yaml",
        "estimates.nc",
        "estimator.nc",
        "observer_spread.nc",
        "findings.json",
        "forecast.nc",
        "freeze.json",
        "recording.nc",
        "report.html",
        "rmse_against_time.png",
        "run.json",
        "score.json",
        "sealed.nc",
        "space_time.png",
        "space_time_truth.png",
        "summary.txt",
    }
    assert all((twin_run.output / name).stat().st_size > 0 for name in left)
    assert "Traceback" not in twin_run.err


def test_what_is_printed_is_what_is_filed(twin_run) -> None:
    summary = (twin_run.output / "summary.txt").read_text()
    assert "Burgers: the simulation compared with recorded sensors" in summary
    assert summary.strip() in twin_run.out
    before, after = twin_run.out.split(summary.strip())
    assert "seal" not in before
    assert "The seal has been opened" in after


def test_the_store_holds_one_finished_run_with_its_stages(twin_run) -> None:
    query = (
        "select runs.name, runs.status, tags.value from runs left join tags "
        "on tags.run_uuid = runs.run_uuid and tags.key = 'mlflow.parentRunId'"
    )
    with sqlite3.connect(twin_run.root / "mlflow.db") as database:
        runs = database.execute(query).fetchall()
        tags = dict(database.execute("select key, value from tags").fetchall())
        metrics = {key for (key,) in database.execute("select distinct key from metrics")}
    database.close()
    parent = json.loads(twin_run.read("run.json"))["mlflow_run"]
    findings = json.loads(twin_run.read("findings.json"))
    assert sorted(runs) == [
        ("assimilate", "FINISHED", parent),
        ("corrected_shred", "FINISHED", parent),
        ("discover", "FINISHED", parent),
        (f"quick seed 0: {short_verdict(findings)}", "FINISHED", None),
        ("shred", "FINISHED", parent),
    ]
    assert tags["twin"] == "a" and tags["system"] == "quick" and "verdict" in tags
    assert tags["mlflow.note.content"].startswith(f"**Verdict: {findings['verdict']}")
    assert tags["findings sha256"] == json.loads(twin_run.read("freeze.json"))["sha256"]
    assert {
        "score/dashred",
        "assimilate/rmse/sensors_validate",
        *headline_metrics(findings),
    } <= metrics
    filed = twin_run.root / "artifacts" / parent / "artifacts" / "findings.json"
    assert filed.read_bytes() == twin_run.read("findings.json")


def test_the_analysis_does_no_more_work_than_before(twin_run) -> None:
    """A change that needs more work shows here on any machine; lower a bound freely."""
    work = json.loads(twin_run.read("run.json"))["work"]
    assert set(work) == set(WORK)
    more = {kind: count for kind, count in work.items() if count > 1.15 * WORK[kind]}
    assert not more, (more, WORK)


def test_findings_hold_no_clock_no_place_and_no_truth(twin_run) -> None:
    text = twin_run.read("findings.json").decode()
    assert str(twin_run.output) not in text and "tracking" not in text
    assert json.loads(text)["input"]["config"]["recording"]["twin"] is None
    assert not re.search(r"seconds|seal|20\d\d-\d\d-\d\dT", text)


def test_the_same_seed_gives_the_same_bytes_in_another_folder(quick, twin_run, train) -> None:
    again = train(f"conf={quick}")
    assert again.code == 0, again.err
    assert again.output != twin_run.output
    for name in ("findings.json", "score.json"):
        assert again.read(name) == twin_run.read(name)
    frozen, before = (json.loads(r.read("freeze.json")) for r in (again, twin_run))
    assert frozen["files"] == before["files"]


def test_another_seed_gives_other_findings(quick, twin_run, train) -> None:
    words = [f"conf={quick}", f"recording.path={twin_run.output / 'recording.nc'}"]
    other = train(*words, "seed=1")
    assert other.code == 0, other.err
    found, before = (json.loads(r.read("findings.json")) for r in (other, twin_run))
    assert found["input"]["recording_sha256"] == before["input"]["recording_sha256"]
    assert found["latent"] != before["latent"]
    assert found["fit"]["test_sensors"] != before["fit"]["test_sensors"]


def test_a_coarse_simulator_is_found_out_and_nothing_else_is_claimed(
    quick, train, tmp_path
) -> None:
    """Nor do results of an earlier run, in the same folder, pass for this one's."""
    (tmp_path / "output").mkdir()
    for name in ("estimates.nc", "score.json", "freeze.json"):
        (tmp_path / "output" / name).write_text("of an earlier run")
    for name in ("where.png", "front_truth.png"):
        save_figure(new_figure(1, 1), tmp_path / "output" / name)
    ended = train(f"conf={quick}", *COARSE)
    assert ended.code == 0, ended.err
    findings = json.loads(ended.read("findings.json"))
    assert findings["verdict"] == "unresolved-numerics"
    [cause] = findings["causes"]
    assert cause["doubling_error"] > 0.01
    assert cause["points"] == {"x": 24} and cause["enough"] == {"x": 48}
    assert "48" in cause["says"] and cause["says"][1:] in ended.out
    assert findings["terms"] is None and findings["latent"] == {"alg1": None, "alg2": None}
    frozen = json.loads(ended.read("freeze.json"))
    assert set(frozen["files"]) == {"findings.json"}
    assert not (ended.output / "estimates.nc").exists()
    assert not list(ended.output.glob("*.png"))
    page = ended.read("report.html").decode()
    assert "the numerical error of the simulation is too large" in page
    assert cause["says"][1:] in page and "<img" not in page
    assert json.loads(ended.read("score.json"))["field_rmse"]["shred"] is None


def test_a_process_that_dies_fails_the_run(quick, train, stand_in, monkeypatch) -> None:
    def killed(*_: object) -> None:
        raise SystemExit(-9)

    monkeypatch.setattr("dashred.pipeline.networks.training.train_shred", killed)

    run = stand_in.run

    def dying(process: Any, words: list[str]) -> None:
        try:
            run(process, words)
        except SystemExit as ended:
            process.code = ended.code

    monkeypatch.setattr(stand_in, "run", dying)
    ended = train(f"conf={quick}")
    assert ended.code == 1
    with sqlite3.connect(ended.root / "mlflow.db") as database:
        statuses = {status for (status,) in database.execute("select status from runs")}
    database.close()
    assert statuses == {"FAILED"}
    assert not (ended.output / "sealed.nc").exists()


@pytest.mark.slow
def test_the_engine_on_128_points_is_unresolved(train) -> None:
    """The truth then runs on 256 points: the doubling error is that of the simulator."""
    coarse = ("system.axes.x.points=128", "simulation.members=24", "simulation.held_out=4")
    ended = train("conf=rde", *coarse, "threads=1")
    assert ended.code == 0, ended.err
    findings = json.loads(ended.read("findings.json"))
    assert findings["verdict"] == "unresolved-numerics"
    [cause] = findings["causes"]
    assert cause["points"] == {"x": 128} and cause["enough"] == {"x": 256}
    assert "256" in cause["says"] and "256" in ended.out


@pytest.mark.slow
@pytest.mark.skipif(not PENDULUM.is_file(), reason=f"{PENDULUM} is not there")
def test_the_real_pendulum_runs_through_and_draws_the_mismatch(train, monkeypatch) -> None:
    monkeypatch.chdir(CHECKOUT)
    path = "recording.path=../shared/data/pendulum_single/recording.csv"
    ended = train("conf=pendulum", path, figures=True)
    assert ended.code == 0, ended.err
    left = {path.name for path in ended.output.iterdir()}
    assert left >= FIGURES | {"findings.json", "freeze.json", "estimates.nc", "summary.txt"}
    findings = json.loads(ended.read("findings.json"))
    assert findings["input"]["splits"]["test"] == []
    # Without friction the simulation swings on, while the recorded pendulum comes to rest.
    assert findings["fit"]["heldout_time"]["simulation"] > 1
