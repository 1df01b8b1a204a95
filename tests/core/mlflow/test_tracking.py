"""Tracking in a store on disk, read back with MLflow's own client."""

import json
import math
import os
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import pytest

from dashred.core.command_line.entry import run_entry
from dashred.core.errors import InputError
from dashred.core.mlflow.metric_names import metric_name
from dashred.core.mlflow.run import flatten
from dashred.core.mlflow.tracker import Tracker
from dashred.core.system_errors import ExternalServiceError
from tests.support.open_together import OPEN_TOGETHER


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> str:
    """One store for the module: creating the tables takes MLflow a second."""
    return str(tmp_path_factory.mktemp("a store #1") / "mlruns")


@pytest.fixture
def tracker(root: str) -> Iterator[Tracker]:
    with Tracker.open(root, "rde", "a run") as opened:
        yield opened


def client_of(tracker: Tracker) -> Any:
    from mlflow import MlflowClient

    return MlflowClient(tracking_uri=tracker.uri)


def data_of(tracker: Tracker, run_id: str) -> Any:
    return client_of(tracker).get_run(run_id).data


def status_of(tracker: Tracker, run_id: str) -> str:
    return str(client_of(tracker).get_run(run_id).info.status)


def test_the_store_lies_under_its_root_and_nowhere_else(
    root: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = Path(root).parent
    monkeypatch.chdir(home)
    with Tracker.open("mlruns", "rde", "a run") as tracker:
        assert tracker.uri == f"sqlite:///{home / 'mlruns' / 'mlflow.db'}"
        tracker.log_metrics({"loss": 1.0}, 0)
        folder = home / "mlruns" / "artifacts" / tracker.run_id / "artifacts"
        assert tracker.artifact_dir == folder
        assert folder.is_dir()
    assert [path.name for path in home.iterdir()] == ["mlruns"]
    names = {path.name for path in (home / "mlruns").iterdir()}
    assert names <= {"mlflow.db", "artifacts", ".mlflow.lock"}


def test_artifacts_are_where_mlflow_looks_for_them(tracker: Tracker, tmp_path: Path) -> None:
    (tracker.artifact_dir / "findings.json").write_text("{}\n", encoding="utf-8")
    for name in ("run.json", "a.png", "not_logged.txt"):
        (tmp_path / name).write_text("{}\n", encoding="utf-8")
    tracker.log_file(tmp_path / "run.json")
    tracker.log_files([tracker.artifact_dir / "findings.json", tmp_path / "a.png"])
    client = client_of(tracker)
    listed = {file.path for file in client.list_artifacts(tracker.run_id)}
    assert listed == {"findings.json", "run.json", "a.png"}


def test_params_of_any_number_type_and_length(tracker: Tracker) -> None:
    many = {f"key.{index}": index for index in range(250)}
    tracker.log_params({**many, "none": None, "flag": True, "list": [1, "a"], "long": "x" * 9999})
    params = data_of(tracker, tracker.run_id).params
    assert len(params) == 254
    assert (params["none"], params["flag"], params["list"]) == ("null", "true", '[1, "a"]')
    assert len(params["long"]) == 6000
    assert params["long"].endswith("x…")


def test_metrics_are_curves_and_more_than_one_batch_goes_through(tracker: Tracker) -> None:
    for step in (0, 1):
        tracker.log_metrics({f"alg1/u/z{index}": index + step for index in range(1001)}, step)
    tracker.send_metrics()
    history = client_of(tracker).get_metric_history(tracker.run_id, "alg1/u/z1000")
    assert [(point.step, point.value) for point in history] == [(0, 1000.0), (1, 1001.0)]


@pytest.mark.parametrize("stop", [False, True])
def test_points_that_wait_are_sent_when_a_nested_run_ends(
    tracker: Tracker, stop: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of the parent too, unless the nested run fails; then they wait for the parent's end."""
    monkeypatch.setattr("dashred.core.mlflow.run.SEND_EVERY", 1e9)
    with suppress(ZeroDivisionError), tracker.child("shred") as child:
        for step in range(3):
            child.log_metrics({"rmse": float(step)}, step)
            tracker.log_metrics({"shred/rmse": float(step)}, step)
        client = client_of(tracker)
        assert len(client.get_metric_history(child.run_id, "rmse")) == 1
        if stop:
            raise ZeroDivisionError
    assert len(client.get_metric_history(child.run_id, "rmse")) == 3
    assert len(client.get_metric_history(tracker.run_id, "shred/rmse")) == (1 if stop else 3)


def test_what_is_not_finite_leaves_a_gap(tracker: Tracker) -> None:
    tracker.log_metrics({"nan": math.nan, "inf": math.inf, "fine": 1.0}, 0)
    metrics = data_of(tracker, tracker.run_id).metrics
    assert math.isnan(metrics["nan"])
    assert math.isnan(metrics["inf"])
    assert metrics["fine"] == 1.0


def test_terms_json_leads_from_metric_names_to_expressions(tracker: Tracker) -> None:
    terms = ["u**3", "d(u, x)", "exp(u - 1)"]
    tracker.log_metrics({metric_name("alg1", "u", term): 0.5 for term in terms}, 0)
    tracker.log_terms(terms)
    table = json.loads((tracker.artifact_dir / "terms.json").read_text(encoding="utf-8"))
    logged = data_of(tracker, tracker.run_id).metrics
    assert [table[name.removeprefix("alg1/u/")] for name in sorted(logged)] == sorted(
        terms, key=lambda term: metric_name("alg1", "u", term)
    )


def test_tags_are_set(tracker: Tracker) -> None:
    tracker.set_tags({"system": "rde", "verdict": None})
    tags = data_of(tracker, tracker.run_id).tags
    assert (tags["system"], tags["verdict"]) == ("rde", "null")


def test_children_are_nested_and_found_by_their_parent(tracker: Tracker) -> None:
    for name in ("shred", "assimilate"):
        with tracker.child(name) as child:
            child.log_metrics({"loss": 0.5}, 3)
            assert status_of(tracker, child.run_id) == "RUNNING"
    client = client_of(tracker)
    experiment = client.get_experiment_by_name("rde").experiment_id
    nested = client.search_runs(
        [experiment], f"tags.`mlflow.parentRunId` = '{tracker.run_id}'", order_by=["start_time"]
    )
    assert [run.info.run_name for run in nested] == ["shred", "assimilate"]
    assert {run.info.status for run in nested} == {"FINISHED"}
    assert child.artifact_dir.is_dir()


@pytest.mark.parametrize(
    ("error", "status"),
    [(ValueError, "FAILED"), (InputError, "FAILED"), (KeyboardInterrupt, "KILLED")],
)
def test_a_failure_marks_child_and_parent(
    root: str, error: type[BaseException], status: str
) -> None:
    with (
        pytest.raises(error),
        Tracker.open(root, "rde", "failing") as tracker,
        tracker.child("shred") as child,
    ):
        raise error("stop")
    assert status_of(tracker, tracker.run_id) == status
    assert status_of(tracker, child.run_id) == status


def test_a_run_of_another_process_is_continued_and_left_open(root: str, tracker: Tracker) -> None:
    with Tracker.open(root, "rde", "unused name", run_id=tracker.run_id) as again:
        again.log_metrics({"loss": 1.0}, 0)
        assert again.artifact_dir == tracker.artifact_dir
    assert status_of(tracker, tracker.run_id) == "RUNNING"
    with (
        pytest.raises(ValueError, match="stop"),
        Tracker.open(root, "rde", "unused name", run_id=tracker.run_id),
    ):
        raise ValueError("stop")
    assert status_of(tracker, tracker.run_id) == "FAILED"


def test_a_run_may_be_nested_below_one_of_another_process(root: str, tracker: Tracker) -> None:
    with Tracker.open(root, "rde", "a row", parent=tracker.run_id) as row:
        assert row.run_id != tracker.run_id
    assert data_of(tracker, row.run_id).tags["mlflow.parentRunId"] == tracker.run_id
    assert status_of(tracker, row.run_id) == "FINISHED"
    assert status_of(tracker, tracker.run_id) == "RUNNING"
    with (
        pytest.raises(InputError, match="there is no run '0123'") as caught,
        Tracker.open(root, "rde", "a row", parent="0123"),
    ):
        pass
    assert caught.value.where == "tracking.parent"


def test_a_nested_run_can_be_renamed_and_a_deleted_one_is_ignored(
    root: str, tracker: Tracker
) -> None:
    with Tracker.open(root, "rde", "rde seed 1", parent=tracker.run_id) as row:
        pass
    tracker.rename(row.run_id, "rde b, seed 1")
    assert client_of(tracker).get_run(row.run_id).info.run_name == "rde b, seed 1"
    client_of(tracker).delete_run(row.run_id)
    tracker.rename(row.run_id, "rde c")
    tracker.rename("0123", "rde d")


def test_an_interrupted_run_is_resumed_and_ended(root: str) -> None:
    with pytest.raises(KeyboardInterrupt), Tracker.open(root, "rde", "a bench") as first:
        raise KeyboardInterrupt
    with Tracker.reopen(root, "rde", first.run_id) as again:
        assert again.run_id == first.run_id
        assert status_of(again, first.run_id) == "RUNNING"
    assert status_of(again, first.run_id) == "FINISHED"


def test_a_run_that_does_not_exist_is_refused(root: str, tracker: Tracker) -> None:
    with (
        pytest.raises(InputError, match="there is no run '0123'"),
        Tracker.open(root, "rde", "a run", run_id="0123"),
    ):
        pass


def test_a_deleted_experiment_is_refused_with_its_name(root: str, tracker: Tracker) -> None:
    with Tracker.open(root, "short-lived", "a run"):
        pass
    client = client_of(tracker)
    client.delete_experiment(client.get_experiment_by_name("short-lived").experiment_id)
    with (
        pytest.raises(InputError, match="short-lived: this experiment was deleted"),
        Tracker.open(root, "short-lived", "a run"),
    ):
        pass


def test_a_store_that_was_moved_is_refused(root: str, tracker: Tracker, tmp_path: Path) -> None:
    moved = shutil.copytree(root, tmp_path / "moved")
    with (
        pytest.raises(InputError, match="artifacts of this experiment are elsewhere"),
        Tracker.open(str(moved), "rde", "a run"),
    ):
        pass


@pytest.mark.parametrize("name", ["50%", "what?"])
def test_a_path_that_mlflow_misreads_is_refused(tmp_path: Path, name: str) -> None:
    with (
        pytest.raises(InputError, match="path with"),
        Tracker.open(str(tmp_path / name), "rde", "a run"),
    ):
        pass
    assert not any(tmp_path.iterdir())


def test_a_root_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with (
        pytest.raises(InputError, match="no MLflow store"),
        Tracker.open(str(tmp_path / "file"), "rde", "a run"),
    ):
        pass


def test_a_database_of_another_mlflow_is_refused(
    root: str, tracker: Tracker, tmp_path: Path
) -> None:
    old = shutil.copytree(root, tmp_path / "old")
    with sqlite3.connect(old / "mlflow.db") as database:
        database.execute("UPDATE alembic_version SET version_num = '0'")
    with (
        pytest.raises(InputError, match="MLflow cannot use this store"),
        Tracker.open(str(old), "rde", "a run"),
    ):
        pass


def test_several_processes_open_one_fresh_store_at_once(tmp_path: Path) -> None:
    root = str(tmp_path / "mlruns")
    command = [sys.executable, "-c", OPEN_TOGETHER, root]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    with sqlite3.connect(tmp_path / "mlruns" / "mlflow.db") as database:
        query = "SELECT name, status FROM runs WHERE name LIKE 'run %' ORDER BY name"
        assert database.execute(query).fetchall() == [(f"run {i}", "FINISHED") for i in range(4)]
        assert database.execute("SELECT count(*) FROM metrics").fetchone() == (44,)
        assert database.execute("SELECT count(*) FROM experiments").fetchone() == (2,)


def test_mlflow_sends_no_telemetry() -> None:
    assert os.environ["MLFLOW_DISABLE_TELEMETRY"] == "true"


def test_flatten_joins_keys_with_dots() -> None:
    tree = {"shred": {"lags": 8, "decoder": [1, 2]}, "seed": 1, "axes": {}}
    assert flatten(tree) == {"shred.lags": 8, "shred.decoder": [1, 2], "seed": 1, "axes": {}}


def test_points_of_an_earlier_attempt_are_not_logged_twice(root: str, tracker: Tracker) -> None:
    tracker.log_metrics({"loss": 1.0}, 0)
    with Tracker.open(root, "rde", "", tracker.run_id) as again:
        again.log_metrics({"loss": 1.0}, 0)
        again.log_metrics({"loss": 0.5}, 1)
    history = client_of(tracker).get_metric_history(tracker.run_id, "loss")
    assert [(point.step, point.value) for point in history] == [(0, 1.0), (1, 0.5)]


def test_a_repeated_stage_replaces_the_interrupted_one(
    tracker: Tracker,
) -> None:
    with suppress(KeyboardInterrupt), tracker.child("shred"):
        raise KeyboardInterrupt
    with tracker.child("shred") as child:
        pass
    client = client_of(tracker)
    [nested] = client.search_runs(
        [client.get_run(tracker.run_id).info.experiment_id],
        f"tags.`mlflow.parentRunId` = '{tracker.run_id}'",
    )
    assert nested.info.run_id == child.run_id


def test_an_experiment_is_described_once(tracker: Tracker) -> None:
    tracker.describe_experiment("what it is about")
    tracker.describe_experiment("something else")
    tags = client_of(tracker).get_experiment_by_name("rde").tags
    assert tags["mlflow.note.content"] == "what it is about"


def test_what_mlflow_refuses_in_the_middle_of_a_run_is_no_wrong_input(
    root: str, tracker: Tracker, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 1: the same command may succeed when the store is available again."""
    from mlflow import MlflowClient
    from mlflow.exceptions import MlflowException

    def gone(*_: object, **__: object) -> None:
        raise MlflowException("the server has gone")

    def log(_: list[str]) -> int:
        tracker.log_metrics({"loss": 1.0}, 0)
        return 0

    def nest(_: list[str]) -> int:
        with tracker.child("shred"):
            return 0

    for method in ("log_batch", "create_run"):
        monkeypatch.setattr(MlflowClient, method, gone)
    for entry in (log, nest):
        assert run_entry(entry) == 1
        [what, hint] = capsys.readouterr().err.splitlines()
        assert what == f"error: {tracker.uri}: MLflow cannot use this store: the server has gone"
        assert f"resume={tracker.run_id}" in hint
    with pytest.raises(InputError, match="the server has gone"), Tracker.open(root, "rde", "new"):
        pass


@pytest.mark.slow
def test_a_locked_database_is_reported_in_a_message(tmp_path: Path) -> None:
    with Tracker.open(str(tmp_path), "rde", "a run") as tracker:
        with closing(sqlite3.connect(tmp_path / "mlflow.db", isolation_level=None)) as database:
            database.execute("BEGIN EXCLUSIVE")
            with pytest.raises(ExternalServiceError, match="locked") as caught:
                tracker.log_metrics({"loss": 1.0}, 0)
        assert f"resume={tracker.run_id}" in str(caught.value)
        tracker.log_metrics({"loss": 1.0}, 0)
