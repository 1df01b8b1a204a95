"""A worker's copy of the package can analyse, and can neither draw, record, open nor score."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from dashred.evaluation.isolation.worker import (
    WorkerLostError,
    isolated_copy,
    isolated_python,
    worker,
)
from tests.test_seal import reached_from


@pytest.fixture(scope="module")
def copy(tmp_path_factory) -> Path:
    return isolated_copy(tmp_path_factory.mktemp("copy"))


def test_the_copy_has_no_evaluation_and_no_twins(copy) -> None:
    assert not (copy / "dashred" / "evaluation").exists()
    assert not [path for path in copy.rglob("*") if {"twins", "proof"} & set(path.parts)]
    assert (copy / "conf" / "fhn.yaml").is_file()


def test_all_that_the_analysis_imports_is_in_the_copy(copy) -> None:
    for module in reached_from("dashred.pipeline.worker"):
        path = copy / Path(*module.split("."))
        assert path.with_suffix(".py").is_file() or (path / "__init__.py").is_file(), module


def test_a_worker_imports_from_the_copy_only(copy) -> None:
    code = "import dashred; from importlib.util import find_spec as f; "
    code += "print(dashred.__file__, f('dashred.evaluation'), f('tests'))"
    command, surroundings = isolated_python(copy)
    told = subprocess.run(
        [*command, "-c", code],
        cwd=copy,
        env=surroundings,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    assert Path(told[0]).is_relative_to(copy)
    assert told[1:] == ["None", "None"]


def test_a_worker_answers_each_recording_and_survives_a_wrong_one(copy, tmp_path) -> None:
    with worker(copy) as mine:
        for words in (["conf=nowhere"], ["conf=fhn", f"recording.path={tmp_path}/none.nc"]):
            code, _ = mine.analyse(words, tmp_path / "log.txt", 100.0)
            assert code == 2
            assert "error:" in (tmp_path / "log.txt").read_text()


def test_a_worker_that_dies_is_distinguished_from_one_that_fails(copy, tmp_path) -> None:
    with worker(copy) as mine:
        mine.process.kill()
        mine.process.wait()
        with pytest.raises(WorkerLostError):
            mine.analyse(["conf=fhn"], tmp_path / "log.txt", 100.0)


def test_an_analysis_ends_when_nobody_waits_for_it(copy, tmp_path) -> None:
    """As after the death of a cluster's worker, whose processes nobody stops."""
    recording = tmp_path / "recording.csv"
    recording.write_text("time,u\n")
    with worker(copy) as mine:
        assert mine.process.stdin is not None
        request = {"words": ["conf=fhn", f"recording.path={recording}"], "log": "/dev/null"}
        mine.process.stdin.write(json.dumps(request) + "\n")
        mine.process.stdin.close()
        assert mine.process.wait(timeout=60) == 0
