"""A kept draw is scored again: of the same truths, by another scorer, and its analyses stay."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from dashred.core.errors import InputError
from dashred.core.findings.findings import freeze, write_json_atomic
from dashred.evaluation.proof.arguments import read_words
from dashred.evaluation.proof.cases.case_store import StoredCase, folder_of, read_case, store_case
from dashred.evaluation.proof.cases.draw import draw_cases, seed_of
from dashred.evaluation.proof.cases.draw_file import read_draw, write_draw
from dashred.evaluation.proof.cases.record_case import RecordedCase, record_case
from dashred.evaluation.proof.scoring import rescore as again
from tests.evaluation.proof.invented import case as record_of
from tests.evaluation.proof.invented import dead

CASE = draw_cases(seed_of("test"), 1, 0)[0]


@pytest.fixture
def drawn(tmp_path: Path) -> Path:
    """Leave the folder of a draw of one case, as the command leaves it."""
    request = read_words(["cases=1", "draw=test", f"output={tmp_path}"])
    write_draw(request)
    folder_of(CASE, tmp_path).mkdir()
    record_case(CASE, folder_of(CASE, tmp_path) / "recording.nc")
    write_json_atomic(folder_of(CASE, tmp_path) / "findings.json", {"verdict": "parameter"})
    freeze(folder_of(CASE, tmp_path), [])
    store_case(CASE, tmp_path, StoredCase(record_of(0, seconds=17.5), 20.0, 1))
    return tmp_path


@pytest.fixture
def scored(monkeypatch: pytest.MonkeyPatch) -> list[RecordedCase]:
    """Have cases scored as missed, and note them."""
    seen: list[RecordedCase] = []

    def score(recorded: RecordedCase, _: Path, seconds: float | None) -> object:
        seen.append(recorded)
        return record_of(0, right=False, seconds=seconds)

    monkeypatch.setattr(again, "score_case", score)
    return seen


def test_a_case_is_scored_once_by_a_commit_and_keeps_its_seconds(drawn, scored) -> None:
    kept = again.rescore_case(CASE, drawn, "c0ffee")
    assert not kept.record["right"] and kept.record["seconds"] == 17.5
    assert (kept.wall, kept.scored_by) == (20.0, "c0ffee")
    assert read_case(CASE, drawn) == kept
    assert again.rescore_case(CASE, drawn, "c0ffee") == kept and len(scored) == 1
    again.rescore_case(CASE, drawn, "beef")
    assert len(scored) == 2


def test_another_recording_than_the_one_that_was_analysed_is_refused(drawn, scored) -> None:
    path = folder_of(CASE, drawn) / "recording.nc"
    path.write_bytes(path.read_bytes() + b"1")
    with pytest.raises(InputError, match="gives another recording"):
        again.rescore_case(CASE, drawn, "c0ffee")
    assert not scored and read_case(CASE, drawn) is not None


def test_findings_that_were_touched_since_are_refused(drawn, scored) -> None:
    write_json_atomic(folder_of(CASE, drawn) / "findings.json", {"verdict": "missing-term"})
    with pytest.raises(InputError):
        again.rescore_case(CASE, drawn, "c0ffee")
    assert not scored


def test_a_draw_that_is_not_finished_is_refused_and_a_dead_case_stays_dead(drawn, scored) -> None:
    other = replace(CASE, number=1)
    with pytest.raises(InputError, match="is not finished"):
        again.rescore_case(other, drawn, "c0ffee")
    store_case(CASE, drawn, StoredCase(dead(), 20.0, 1))
    assert again.rescore_case(CASE, drawn, "c0ffee").record["problem"] and not scored


def test_the_words_take_the_draw_from_its_folder(drawn, monkeypatch) -> None:
    monkeypatch.setattr("dashred.evaluation.proof.arguments.commit_under_test", lambda: "c0ffee")
    request = read_words([f"score={drawn}"])
    assert (request.cases, request.nulls, request.draw, request.practice) == (1, 0, "test", True)
    assert (request.output, request.scored_by) == (drawn, "c0ffee")
    with pytest.raises(InputError, match="score= cannot be combined with cases="):
        read_words([f"score={drawn}", "cases=3"])


@pytest.mark.parametrize("text", ["{", "[]", '{"draw": 3}', None])
def test_what_is_no_draw_is_refused(drawn, text) -> None:
    path = drawn / "draw.json"
    known = json.loads(path.read_text())
    path.write_text(json.dumps(known | {"cases": -1}) if text is None else text)
    with pytest.raises(InputError, match="does not describe a draw"):
        read_draw(drawn)
    path.unlink()
    with pytest.raises(InputError, match="no draw in this folder"):
        read_draw(drawn)
