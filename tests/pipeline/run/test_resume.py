"""A resumed run gives the same bytes in the same MLflow run, without access to a twin."""

from __future__ import annotations

import json
import os
import sqlite3
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from dashred.config import bundled_names, frozen_input, load_config
from dashred.core.budget import Budget
from dashred.core.errors import InputError
from dashred.pipeline.run.checkpoints import Checkpoints
from dashred.pipeline.run.resume import named_folder, read_words
from dashred.pipeline.run.run_manifest import MANIFEST, WORDS, stored_arguments, write_manifest

# Of a twin's noise: a number that nothing else has.
NOISE = "0.0213578"


def interrupted(*_: object, **__: object) -> None:
    raise KeyboardInterrupt


def no_second_time(*_: object, **__: object) -> None:
    pytest.fail("this stage had finished before the interruption")


def rows(root: Path, query: str) -> list[tuple[Any, ...]]:
    with closing(sqlite3.connect(root / "mlflow.db")) as database:
        return database.execute(query).fetchall()


def parent_of(root: Path) -> tuple[str, str]:
    """Return id and status of the one parent run that is active."""
    children = "select run_uuid from tags where key = 'mlflow.parentRunId'"
    query = "select run_uuid, status from runs where lifecycle_stage = 'active'"
    [found] = rows(root, f"{query} and run_uuid not in ({children})")
    return found


def children_of(root: Path) -> list[tuple[Any, ...]]:
    query = "select name, status from runs join tags using (run_uuid) where key = "
    query += "'mlflow.parentRunId' and lifecycle_stage = 'active'"
    return sorted(rows(root, query))


def test_a_resumed_twin_gives_the_same_bytes_in_the_same_run(
    quick, twin_run, train, monkeypatch, tmp_path, own_state
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr("dashred.pipeline.surrogate.retrain", interrupted)
        assert train(f"conf={quick}").code == 130
    root, output = tmp_path / "mlruns", tmp_path / "output"
    run_id, status = parent_of(root)
    assert status in ("FAILED", "KILLED")
    assert not list(output.rglob("sealed.nc")) + list(root.rglob("sealed.nc"))
    stages = (
        "networks.training.train_shred",
        "networks.assimilation.assimilate",
        "discovery.discovery.discover",
    )
    for stage in stages:
        monkeypatch.setattr(f"dashred.pipeline.{stage}", no_second_time)

    ended = train(f"resume={run_id}")

    assert ended.code == 0, ended.err
    for name in ("findings.json", "score.json"):
        assert ended.read(name) == twin_run.read(name)
    assert (ended.output / "sealed.nc").is_file()
    assert parent_of(root) == (run_id, "FINISHED")
    names = ("assimilate", "corrected_shred", "discover", "shred")
    assert children_of(root) == [(name, "FINISHED") for name in names]
    twice = "select key, step, count(*) from metrics group by run_uuid, key, step having count(*)>1"
    assert rows(root, twice) == []
    seconds = json.loads(ended.read("run.json"))["seconds"]
    assert {"train SHRED", "select the law", "train corrected SHRED"} <= seconds.keys()
    # What an attempt that was cut short has learned took its time, too.
    stages = sum(value for title, value in seconds.items() if title != "in all")
    assert seconds["in all"] > 0.99 * stages
    assert not list((root / "artifacts").glob("*/checkpoints/*"))
    assert not list((own_state / "dashred" / "recorder").glob(run_id))

    again = train(f"resume={run_id}")
    assert again.code == 2 and "has finished" in again.err


def test_the_same_command_in_the_same_folder_resumes(
    quick, twin_run, train, monkeypatch, tmp_path
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr("dashred.pipeline.discovery.discovery.discover", interrupted)
        assert train(f"conf={quick}").code == 130
    run_id, _ = parent_of(tmp_path / "mlruns")
    monkeypatch.setattr("dashred.pipeline.networks.training.train_shred", no_second_time)
    ended = train(f"conf={quick}")
    assert ended.code == 0, ended.err
    assert ended.read("findings.json") == twin_run.read("findings.json")
    assert parent_of(ended.root) == (run_id, "FINISHED")


def test_a_run_resumes_with_its_own_recording_only(
    quick, twin_run, train, monkeypatch, tmp_path
) -> None:
    own = tmp_path / "own.nc"
    own.write_bytes(twin_run.read("recording.nc"))
    with monkeypatch.context() as patch:
        patch.setattr("dashred.pipeline.networks.assimilation.assimilate", interrupted)
        assert train(f"conf={quick}", f"recording.path={own}").code == 130
    root = tmp_path / "mlruns"
    run_id, _ = parent_of(root)
    kept = root / "artifacts" / run_id / "checkpoints"
    began = json.loads((kept / MANIFEST).read_text())

    (kept / MANIFEST).write_text(json.dumps(began | {"torch": "1.0"}))
    refused = train(f"resume={run_id}")
    assert refused.code == 2
    assert f"torch was 1.0, is {torch.__version__}" in refused.err

    (kept / MANIFEST).write_text(json.dumps(began | {"the recording": "0"}))
    refused = train(f"resume={run_id}")
    assert refused.code == 2 and "the recording has changed" in refused.err
    assert "Traceback" not in refused.err

    (kept / MANIFEST).write_text(json.dumps(began))
    monkeypatch.setattr("dashred.pipeline.networks.training.train_shred", no_second_time)
    ended = train(f"resume={run_id}")
    assert ended.code == 0, ended.err
    before = json.loads(twin_run.read("findings.json"))
    found = json.loads(ended.read("findings.json"))
    assert found["terms"] == before["terms"] and found["fit"] == before["fit"]


def test_nothing_of_a_twin_lies_where_the_analysis_or_the_store_shows_it(
    quick, train, monkeypatch, tmp_path, own_state
) -> None:
    monkeypatch.setattr("dashred.pipeline.networks.training.train_shred", interrupted)
    words = ("recording.twin=b", f"recording.noise={NOISE}")
    assert train(f"conf={quick}", *words).code == 130
    run_id, _ = parent_of(tmp_path / "mlruns")
    shown = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert {"mlflow.db", "recording.nc", MANIFEST, "quick.yaml"} <= {path.name for path in shown}
    for path in shown:
        assert path.name != "sealed.nc"
        held = path.read_bytes()
        assert NOISE.encode() not in held, path
    kept = tmp_path / "mlruns" / "artifacts" / run_id / "checkpoints" / "config" / "quick.yaml"
    assert json.loads(kept.read_text())["recording"].keys() == {"every"}
    seal = own_state / "dashred" / "recorder" / run_id / "sealed.nc"
    assert seal.is_file()
    assert seal.parent.stat().st_mode & 0o077 == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("resume=0123",), "there is no run '0123'"),
        (("resume=",), "resume= is empty"),
        (("resume=0123", "seed=1"), "resume= cannot be combined with seed="),
    ],
)
def test_invalid_resume_arguments_are_refused(
    twin_run, capsys, monkeypatch, words, message
) -> None:
    from dashred.core.command_line.entry import run_entry
    from dashred.train import main

    monkeypatch.setattr("sys.argv", ["train", *words, f"tracking.root={twin_run.root}"])
    assert run_entry(main) == 2
    error = capsys.readouterr().err
    assert message in error and "Traceback" not in error


def test_a_folder_without_a_store_is_refused_and_left_alone(tmp_path, capsys, monkeypatch) -> None:
    from dashred.core.command_line.entry import run_entry
    from dashred.train import main

    monkeypatch.setattr("sys.argv", ["train", "resume=0123", f"tracking.root={tmp_path / 'no'}"])
    assert run_entry(main) == 2
    assert "there is no MLflow store here" in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


@pytest.mark.parametrize("name", bundled_names())
def test_a_settled_configuration_reads_back_as_the_same_input(name: str, tmp_path: Path) -> None:
    words = [f"recording.path={tmp_path / 'mine.csv'}", "seed=3", "shred.rate=1e-4"]
    config = load_config([f"conf={name}", *words, "output=there"], entry="train")
    write_manifest(tmp_path, config, {})
    kept = stored_arguments(tmp_path)
    assert kept is not None and not any("there" in word for word in kept)
    again = load_config(kept, entry="train")
    assert frozen_input(again) == frozen_input(config)
    assert (again.name, again.tracking.model) == (config.name, config.tracking.model)
    assert again.recording.path == config.recording.path


@pytest.mark.parametrize(
    "word",
    [
        *("trust=evil.E", "conf=evil.yaml", "resume=0123", "output=/tmp/evil", "--help", 7),
        *("tracking.root=http://evil", "tracking.run=0123", "recording.twin=a", "tracking={}"),
    ],
)
def test_a_stored_argument_reserved_for_the_user_is_refused(word, tmp_path) -> None:
    """A run may come from a foreign store: resuming it must not run foreign code."""
    config = load_config(["conf=rde", "recording.path=mine.csv", "seed=3"], entry="train")
    write_manifest(tmp_path, config, {})
    kept = json.loads((tmp_path / WORDS).read_text())
    assert (stored_arguments(tmp_path) or [])[1:] == kept and "seed=3" in kept
    (tmp_path / WORDS).write_text(json.dumps(["system.class=evil.E", word]))
    with pytest.raises(InputError, match="tampered with") as caught:
        stored_arguments(tmp_path)
    assert caught.value.where == str(tmp_path / WORDS) and str(word) in caught.value.what
    (tmp_path / WORDS).write_text("no words at all")
    assert stored_arguments(tmp_path) is None


@pytest.mark.parametrize(
    ("word", "message"),
    [
        *(("output=", "is empty"), ("tracking.root=", "is empty"), ("trust=", "is empty")),
        ("output", "expected key=value"),
        ("seed=1", "resume= cannot be combined with seed="),
        ("resume=4567", "given twice"),
    ],
)
def test_a_wrong_argument_with_resume_is_refused(word, message) -> None:
    """An empty `output=` would be the current folder."""
    with pytest.raises(InputError, match=message):
        read_words(["resume=0123", word])


def test_home_and_relative_folders_are_resolved(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)
    assert named_folder("~/found") == str(tmp_path / "home" / "found")
    assert named_folder("found") == str(tmp_path / "found")


class Runs:
    """A class that a checkpoint must not name."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Run a command when unpickled."""
        return os.system, ("echo run > ran.txt",)


def test_a_checkpoint_that_would_run_code_is_not_read(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    torch.save({"found": Runs(), "seconds": {}}, tmp_path / "shred.pt")
    assert Checkpoints(tmp_path, {}, Budget()).stage("shred", lambda: {"a": 1}) == {"a": 1}
    assert not (tmp_path / "ran.txt").exists()


def test_seconds_of_an_earlier_attempt_are_counted_once(tmp_path, monkeypatch) -> None:
    clock = iter([10.0, 17.5, 20.0, 22.0])
    monkeypatch.setattr(
        "dashred.pipeline.run.checkpoints.time", SimpleNamespace(perf_counter=lambda: next(clock))
    )
    first = Checkpoints(tmp_path, {}, Budget())
    first.stage("shred", lambda: {"a": 1})
    assert first.earlier == 0.0
    second = Checkpoints(tmp_path, {}, Budget())
    second.stage("shred", lambda: pytest.fail("kept"))
    second.stage("assimilate", lambda: {"b": 2})
    assert second.earlier == 7.5


def test_a_truncated_checkpoint_is_computed_again(tmp_path) -> None:
    kept = Checkpoints(tmp_path, {}, Budget())
    assert kept.stage("shred", lambda: {"a": torch.ones(9)})["a"].sum() == 9
    path = tmp_path / "shred.pt"
    path.write_bytes(path.read_bytes()[:-40])
    assert Checkpoints(tmp_path, {}, Budget()).stage("shred", lambda: {"a": 1}) == {"a": 1}
    assert Checkpoints(tmp_path, {}, Budget()).stage("shred", lambda: pytest.fail("kept")) == {
        "a": 1
    }


def test_a_checkpoint_of_another_version_is_computed_again(tmp_path: Path, monkeypatch) -> None:
    kept = Checkpoints(tmp_path, {}, Budget())
    assert kept.stage("count", lambda: 1) == kept.stage("count", lambda: 2) == 1
    monkeypatch.setattr("dashred.pipeline.run.checkpoints.git_commit", lambda: "another")
    assert kept.stage("count", lambda: 2) == kept.stage("count", lambda: 3) == 2
