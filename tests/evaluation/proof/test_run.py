"""The proof as a command: kept cases are kept, a crash is a record, and one real run."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from dashred.core.errors import InputError
from dashred.evaluation.isolation.worker import Worker, WorkerLostError
from dashred.evaluation.proof import run as proof
from dashred.evaluation.proof.arguments import read_words
from dashred.evaluation.proof.cases import case_store
from dashred.evaluation.proof.cases.draw import draw_cases, seed_of
from dashred.evaluation.proof.request import Request
from dashred.evaluation.proof.scoring.rescore import rescore
from tests.evaluation.proof.invented import case as record_of

CHECKOUT = Path(__file__).resolve().parents[3]


def request(folder: Path, cases: int) -> Request:
    return read_words([f"cases={cases}", "draw=test", f"output={folder}"])


def keep(folder: Path, seed: str, cases: int) -> None:
    """Leave what finished cases leave."""
    for case in draw_cases(seed_of(seed), cases, 0):
        place = folder / str(case).replace(" ", "-")
        place.mkdir(parents=True)
        case_store.store_case(case, folder, case_store.StoredCase(record_of(case.number), 10.0, 1))


@pytest.fixture
def analysed(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Have workers note their words, and fail."""
    told: list[list[str]] = []

    def analyse(self: Worker, words: list[str], log: Path, limit: float) -> tuple[int, float]:
        told.append(list(words))
        log.write_text("Traceback\n  deep inside\nValueError: out of luck\n")
        return 1, 0.5

    monkeypatch.setattr(Worker, "analyse", analyse)
    return told


def test_cases_that_are_done_are_not_run_again(tmp_path, analysed) -> None:
    keep(tmp_path, "test", 2)
    kept = proof.run_proof(request(tmp_path, 2))
    assert not analysed
    assert [one.record["number"] for one in kept] == [0, 1] and kept[0].wall == 10.0


def test_cases_of_another_draw_are_not_taken_for_these(tmp_path, analysed) -> None:
    keep(tmp_path, "another", 1)
    proof.run_proof(request(tmp_path, 1))
    assert len(analysed) == 1


def test_a_crash_is_a_record_and_is_tried_again(tmp_path, analysed) -> None:
    [kept] = proof.run_proof(request(tmp_path, 1))
    assert kept.record["problem"] == "ValueError: out of luck" and not kept.record["right"]
    assert not (tmp_path / "case-0" / "sealed.nc").exists()
    proof.run_proof(request(tmp_path, 1))
    assert len(analysed) == 2


def test_an_interruption_ends_the_workers_and_keeps_no_record(tmp_path, monkeypatch) -> None:
    begun = threading.Event()

    def analyse(self: Worker, words: list[str], log: Path, limit: float) -> tuple[int, float]:
        begun.set()
        self.process.wait()
        raise WorkerLostError("killed")

    monkeypatch.setattr(Worker, "analyse", analyse)
    main = threading.main_thread().ident
    assert main is not None

    def interrupt() -> None:
        begun.wait()
        signal.pthread_kill(main, signal.SIGINT)

    threading.Thread(target=interrupt, daemon=True).start()
    with pytest.raises(KeyboardInterrupt):
        proof.run_proof(request(tmp_path, 3))
    assert not list(tmp_path.glob("*/case.json"))


def test_an_worker_is_told_of_its_recording_alone(tmp_path, analysed) -> None:
    proof.run_proof(request(tmp_path, 2))
    cases = draw_cases(seed_of("test"), 2, 0)
    for case, words in zip(cases, analysed, strict=True):
        keys = [word.partition("=")[0] for word in words]
        told: tuple[str, ...] = ("conf", "recording.path", "output", "seed", "tracking.root")
        told += ("tracking.experiment", "tracking.model")
        assert set(told) <= set(keys)
        others = {"shred.epochs", "assimilation.epochs", "threads", *case.words}
        assert set(keys) - set(told) <= others
        said = " ".join(words)
        assert str(case.key[0]) not in said and str(tmp_path) not in said
        assert f"seed={case.analysis_seed}" in words and str(case).replace(" ", "-") not in said


def test_a_case_that_cannot_be_recorded_or_judged_is_a_record(tmp_path, monkeypatch) -> None:
    def fail(*_: object) -> None:
        raise ValueError("out of reach")

    monkeypatch.setattr(Worker, "analyse", lambda *_: (0, 1.0))
    monkeypatch.setattr(proof, "check_freeze", fail)
    [kept] = proof.run_proof(request(tmp_path, 1))
    assert kept.record["problem"] == "ValueError: out of reach"
    # It is analysed again: until then nothing tells what it hides.
    assert kept.record["hidden"] == "not opened" and kept.record["mismatch"] is None
    assert "out of reach" in (tmp_path / "case-0" / "problem.txt").read_text()
    monkeypatch.setattr(proof, "record_case", fail)
    [kept] = proof.run_proof(request(tmp_path, 1))
    assert kept.record["hidden"] == "not opened"


def test_an_analysis_finds_its_recording_and_nothing_else(tmp_path, monkeypatch) -> None:
    """Also where an earlier try had gone as far as to open the seal."""
    seen: list[list[str]] = []

    def analyse(self: Worker, words: list[str], log: Path, limit: float) -> tuple[int, float]:
        path = next(Path(w.partition("=")[2]) for w in words if w.startswith("recording.path="))
        seen.append(sorted(file.name for file in path.parent.iterdir()))
        assert not list(tmp_path.rglob("sealed.nc"))
        log.write_text("failed\n")
        return 1, 0.5

    monkeypatch.setattr(Worker, "analyse", analyse)
    (tmp_path / "case-0").mkdir()
    (tmp_path / "case-0" / "sealed.nc").write_text("the truth")
    proof.run_proof(request(tmp_path, 1))
    assert seen == [["recording.nc"]]


@pytest.mark.parametrize("word", ["cases=many", "case=3", "jobs", "nulls=-1"])
def test_wrong_words_are_refused(word) -> None:
    with pytest.raises(InputError):
        read_words([word, "draw=test"])


def test_the_commit_draws_unless_it_is_practice(monkeypatch) -> None:
    monkeypatch.setattr(
        "dashred.evaluation.proof.arguments.commit_under_test", lambda: "c0ffee" * 6
    )
    real = read_words(["cases=5"])
    assert real.draw == "c0ffee" * 6 and not real.practice
    assert real.output.name == "c0ffeec0ffee"
    assert read_words(["draw=mine"]).practice


@pytest.mark.slow
def test_a_proof_from_the_draw_to_the_document(tmp_path) -> None:
    command = [sys.executable, "-m", "dashred", "prove", "cases=2", "nulls=1", "draw=test"]
    command += ["jobs=2", f"output={tmp_path}"]
    done = subprocess.run(command, cwd=CHECKOUT, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stderr
    records = json.loads((tmp_path / "records.json").read_text())["records"]
    assert [record["group"] for record in records] == ["cases", "cases", "nulls"]
    assert not any(record["problem"] for record in records)
    assert sum(record["right"] or record["listed"] for record in records) >= 2
    page = (tmp_path / "proof.md").read_text()
    assert "this is a practice draw, not the proof" in page
    for folder in ("case-0", "case-1", "null-0"):
        frozen, opened = (tmp_path / folder / n for n in ("freeze.json", "sealed.nc"))
        assert frozen.stat().st_mtime <= opened.stat().st_mtime

    frozen = (tmp_path / "case-0" / "findings.json").read_bytes()
    words = read_words(["cases=2", "nulls=1", "draw=test", f"output={tmp_path}"])
    again = rescore(replace(words, scored_by="c0ffee"))
    assert [one.record for one in again] == records
    assert {one.scored_by for one in again} == {"c0ffee"}
    assert (tmp_path / "case-0" / "findings.json").read_bytes() == frozen
