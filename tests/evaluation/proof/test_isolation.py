"""An analyst's copy of the package can analyse, and can neither draw, record, open nor score."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from dashred.evaluation.proof.isolation import (
    CONCEALED,
    AnalystLostError,
    analyst,
    bare_copy,
    python,
)
from tests.test_seal import SECRET, reached_by_the_analysis


@pytest.fixture(scope="module")
def copy(tmp_path_factory) -> Path:
    return bare_copy(tmp_path_factory.mktemp("copy"))


def test_nothing_that_knows_of_truths_is_in_the_copy(copy) -> None:
    names = {path.name for path in copy.rglob("*")}
    assert not names & set(CONCEALED)
    modules = {path.stem for path in (copy / "dashred").iterdir()}
    assert not modules & SECRET
    assert not (copy / "conf" / "twins").exists()
    assert (copy / "conf" / "fhn.yaml").is_file()


def test_all_that_the_analysis_reaches_is_in_the_copy(copy) -> None:
    for module in reached_by_the_analysis():
        path = copy / Path(*module.split("."))
        assert path.with_suffix(".py").is_file() or (path / "__init__.py").is_file(), module


def test_the_analyst_runs_the_copy_and_no_other(copy) -> None:
    code = "import dashred; from importlib.util import find_spec as f; "
    code += "print(dashred.__file__, f('dashred.evaluation.twins.record_command'), f('tests'))"
    command, surroundings = python(copy)
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


def test_an_analyst_answers_each_recording_and_outlives_a_wrong_one(copy, tmp_path) -> None:
    with analyst(copy) as mine:
        for words in (["conf=nowhere"], ["conf=fhn", f"recording.path={tmp_path}/none.nc"]):
            code, _ = mine.analyse(words, tmp_path / "log.txt", 100.0)
            assert code == 2
            assert "error:" in (tmp_path / "log.txt").read_text()


def test_an_analyst_that_dies_is_told_apart_from_one_that_fails(copy, tmp_path) -> None:
    with analyst(copy) as mine:
        mine.process.kill()
        mine.process.wait()
        with pytest.raises(AnalystLostError):
            mine.analyse(["conf=fhn"], tmp_path / "log.txt", 100.0)
