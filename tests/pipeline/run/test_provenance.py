"""Provenance, device checks and the output folder of a run."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
import torch

from dashred.config import Config, load_config
from dashred.core.errors import InputError
from dashred.core.threads import use_threads
from dashred.pipeline.run import provenance
from dashred.pipeline.run.output_dir import check_output, clear_output, make_output, named_output
from dashred.reporting.figures.style import new_figure, save_figure
from tests.conftest import CHECKOUT


@pytest.fixture(autouse=True)
def _as_it_was():
    yield
    torch.use_deterministic_algorithms(False)
    use_threads(1)


@pytest.mark.parametrize(
    ("device", "count", "fits"),
    [("cpu", 0, True), ("cuda", 0, False), ("cuda", 1, True), ("cuda:1", 1, False)],
)
def test_a_device_must_be_there(quick, monkeypatch, device, count, fits) -> None:
    monkeypatch.setattr(torch.cuda, "device_count", lambda: count)
    config = load_config([f"conf={quick}", f"device={device}"], entry="train")
    if fits:
        provenance.prepare_torch(config)
        assert torch.are_deterministic_algorithms_enabled()
        return
    with pytest.raises(InputError, match=f"{count} CUDA devices, not '{device}'") as caught:
        provenance.prepare_torch(config)
    assert caught.value.where == "command line" and caught.value.hint == "choose device=cpu"


def test_a_commit_is_marked_when_files_are_changed(monkeypatch) -> None:
    answers = {"rev-parse": f"{CHECKOUT}\nabc\n", "status": "", "ls-files": "dashred/__init__.py\n"}

    def git(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(command, 0, answers[command[1]], "")

    monkeypatch.setattr(subprocess, "run", git)
    assert provenance.git_commit() == "abc"
    answers["status"] = " M dashred/train.py\n"
    assert provenance.git_commit() == "abc+"


def test_the_commit_of_another_repository_is_not_reported(monkeypatch) -> None:
    """Where the package lies within it, as a part of it or in its .venv."""

    def git(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(command, 0, f"{CHECKOUT.parent}\nabc\n", "")

    monkeypatch.setattr(subprocess, "run", git)
    assert provenance.git_commit() == "unknown"
    monkeypatch.setattr(provenance, "IS_INSTALLED", True)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: pytest.fail("git was asked"))
    assert provenance.git_commit() == "unknown"


def test_without_git_the_commit_is_unknown(monkeypatch) -> None:
    def missing(*_: object, **__: object) -> None:
        raise FileNotFoundError("git")

    monkeypatch.setattr(subprocess, "run", missing)
    assert provenance.git_commit() == "unknown"


def test_an_output_folder_is_made_and_cleared_of_results_alone(tmp_path) -> None:
    folder = make_output(str(tmp_path / "a" / "b"))
    for name in ("findings.json", "freeze.json", "score.json", "estimates.nc", "run.json"):
        (folder / name).touch()
    for name in ("recording.nc", "sealed.nc", "notes.txt"):
        (folder / name).touch()
    clear_output(folder)
    assert {path.name for path in folder.iterdir()} == {"recording.nc", "sealed.nc", "notes.txt"}
    with pytest.raises(InputError, match="cannot be created"):
        make_output(str(folder / "notes.txt" / "c"))


def test_only_figures_of_an_earlier_run_are_cleared(tmp_path) -> None:
    ours = {"where.png", "learning.png", "sensor_traces_12.png", "front_truth.png"}
    theirs = {"sensor_traces_mine.png", "my_truth.png", "where.png.bak", "photo.png"}
    for name in ours | theirs:
        save_figure(new_figure(1, 1), tmp_path / name)
    # By one of our names, and drawn by somebody else.
    new_figure(1, 1).savefig(tmp_path / "forecast.png")
    theirs.add("forecast.png")
    clear_output(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == ours | theirs
    (tmp_path / "freeze.json").touch()
    clear_output(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == theirs


def of_a_run(output: Path) -> Config:
    return load_config(["conf=rde", f"output={output}"], entry="train")


@pytest.mark.parametrize("name", ["summary.txt", "report.html", "run.json", "score.json"])
def test_a_folder_with_foreign_results_is_refused(tmp_path: Path, name: str) -> None:
    config = of_a_run(tmp_path)
    (tmp_path / name).write_text("mine")
    for checked in (named_output, check_output):
        with pytest.raises(InputError, match=f"replace {name}, which was not written by dashred"):
            checked(config)
    assert (tmp_path / name).read_text() == "mine"


@pytest.mark.parametrize("mark", ["freeze.json", ".run"])
def test_a_folder_that_a_run_has_left_is_used_again(tmp_path: Path, mark: str) -> None:
    for name in (mark, "summary.txt"):
        (tmp_path / name).touch()
    assert named_output(of_a_run(tmp_path)) == tmp_path
    check_output(of_a_run(tmp_path))


def test_a_run_does_not_overwrite_its_input(tmp_path: Path) -> None:
    for name in ("freeze.json", "findings.json"):
        (tmp_path / name).touch()
    corrected = tmp_path / "corrected.yaml"
    corrected.write_text(Path("conf/rde.yaml").read_text())
    config = load_config([f"conf={corrected}", f"output={tmp_path}"], entry="train")
    with pytest.raises(InputError, match=r"overwrite its own input corrected\.yaml"):
        named_output(config)


def test_an_output_may_hold_the_store_of_which_it_keeps_no_copy(tmp_path: Path) -> None:
    words = ["conf=rde", f"output={tmp_path}", f"tracking.root={tmp_path / 'runs'}"]
    assert named_output(load_config(words, entry="train")) == tmp_path
