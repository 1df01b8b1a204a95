"""A case from end to end, without an analysis: findings are invented in its place."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from dashred.core.errors import DONE, OUR_FAILURE, InputError
from dashred.core.findings.findings import freeze, write_json_atomic
from dashred.evaluation.foreign import run
from dashred.evaluation.foreign.arguments import Request, read_words
from dashred.evaluation.foreign.cases.case import Case, MadeCase
from dashred.evaluation.foreign.document import write_document
from dashred.evaluation.foreign.make_case import make_case
from dashred.evaluation.foreign.rows import PeerRow
from dashred.evaluation.isolation.worker import Worker, WorkerLostError
from tests.evaluation.foreign.invented import findings_of, term

CASE = Case("mechanics", "dry_friction", "term", 0, 0.02, 11)
Analyse = Callable[[Path, Path], int]


def request(folder: Path) -> Request:
    words = ["foreign", "run", "draw=test", f"output={folder / 'out'}", "peer_limit=0"]
    return read_words([*words, f"document={folder / 'page.md'}"])


@pytest.fixture
def analysed_by(monkeypatch: pytest.MonkeyPatch) -> Callable[[Analyse], list[Path]]:
    """Have a function stand in for the analysis; return the folders that it is given."""
    seen: list[Path] = []

    def install(analysis: Analyse) -> list[Path]:
        def analyse(
            self: Worker, words: Sequence[str], log: Path, limit: float
        ) -> tuple[int, float]:
            told = dict(word.split("=", 1) for word in words)
            given, found = Path(told["conf"]).parent, Path(told["output"])
            seen.append(given)
            log.write_text("log\nerror: out of luck\n")
            found.mkdir()
            return analysis(given, found), 12.5

        monkeypatch.setattr(Worker, "analyse", analyse)
        return seen

    return install


def answer(verdict: str, terms: Sequence[dict[str, Any]]) -> Analyse:
    """Return an analysis that writes these findings."""

    def analysis(given: Path, found: Path) -> int:
        section = yaml.safe_load((given / "case.yaml").read_text())["system"]
        write_json_atomic(found / "findings.json", findings_of(section, verdict, terms))
        freeze(found, [])
        return DONE

    return analysis


def test_a_case_is_made_analysed_frozen_scored_and_stored(tmp_path, analysed_by) -> None:
    in_sight: list[str] = []

    def analysis(given: Path, found: Path) -> int:
        in_sight.extend(path.name for path in given.parent.rglob("*") if path.is_file())
        assert not list((tmp_path / "out").rglob("*dry_friction*"))
        _, rest = (given / "recording.csv").read_text().split("\n", 1)
        assert len(rest.splitlines()) == 401
        mu = make_case(CASE).truth.terms[0].coefficient
        return answer("missing-term", [term("v", "sign(v)", mu)])(given, found)

    seen = analysed_by(analysis)
    [row] = run.run_foreign(request(tmp_path), [CASE])
    assert in_sight and not [name for name in in_sight if "truth" in name or "full" in name]
    assert row["outcome"] == "right" and row["verdict"] == "missing-term", row
    assert row["covered"] == [True] and row["gain_sensors"] == 4.0 and row["seconds"] == 12.5
    truth = json.loads((tmp_path / "out" / "truths" / f"{CASE.name}.json").read_text())
    assert truth["terms"][0][:2] == ["v", "sign(v)"]
    kept = tmp_path / "out" / "analyses" / CASE.name
    assert (kept / "case" / "case.yaml").is_file()
    assert (kept / "findings" / "freeze.json").is_file()
    # The same command again runs nothing.
    again = run.run_foreign(request(tmp_path), [CASE])
    assert again == [row] and len(seen) == 1


def test_several_cases_at_once(tmp_path, analysed_by) -> None:
    analysed_by(answer("nothing-missing", []))
    cases = [replace(CASE, kind="nothing", number=number) for number in range(3)]
    rows = run.run_foreign(replace(request(tmp_path), jobs=2), cases)
    assert [row["case"] for row in rows] == [case.name for case in cases]
    assert {row["outcome"] for row in rows} == {"right"}


def test_only_the_chosen_cases_are_run_but_the_draw_is_complete(tmp_path, analysed_by) -> None:
    seen = analysed_by(answer("nothing-missing", []))
    cases = [replace(CASE, kind="nothing", number=number) for number in range(3)]
    asked = replace(request(tmp_path), cases=(cases[1].name,))
    [row] = run.run_foreign(asked, cases)
    assert row["case"] == cases[1].name and len(seen) == 1
    write_document(asked)
    assert "1 of 3 cases are done" in (tmp_path / "page.md").read_text()
    assert "The draw is incomplete" in (tmp_path / "page.md").read_text()


def test_a_definite_verdict_that_is_wrong_is_silently_wrong(tmp_path, analysed_by) -> None:
    analysed_by(answer("missing-term", [term("v", "v", -0.3)]))
    [row] = run.run_foreign(request(tmp_path), [CASE])
    assert row["outcome"] == "silent-wrong" and row["covered"] == []


def test_an_analysis_that_fails_is_a_row_without_an_answer(tmp_path, analysed_by) -> None:
    seen = analysed_by(lambda given, found: OUR_FAILURE)
    [row] = run.run_foreign(request(tmp_path), [CASE])
    assert row["outcome"] == "no-answer" and row["problem"] == "error: out of luck"
    run.run_foreign(request(tmp_path), [CASE])
    assert len(seen) == 1  # what was drawn and failed is not tried again


def test_an_analysis_that_ends_without_a_word_is_a_row_too(tmp_path, analysed_by) -> None:
    def lost(given: Path, found: Path) -> int:
        raise WorkerLostError("exit code -9")

    analysed_by(lost)
    [row] = run.run_foreign(request(tmp_path), [CASE])
    assert row["outcome"] == "no-answer" and "exit code -9" in str(row["problem"])


def test_findings_that_changed_after_they_were_frozen_are_not_scored(tmp_path, analysed_by) -> None:
    def tampering(given: Path, found: Path) -> int:
        answer("nothing-missing", [])(given, found)
        (found / "findings.json").write_text((found / "findings.json").read_text() + " ")
        return DONE

    seen = analysed_by(tampering)
    [row] = run.run_foreign(request(tmp_path), [CASE])
    assert row["outcome"] == "no-answer" and "changed after" in str(row["problem"])
    run.run_foreign(request(tmp_path), [CASE])
    assert len(seen) == 2  # that was no failure of the analysis: it is run again


def test_rows_of_two_draws_are_not_mixed(tmp_path, analysed_by) -> None:
    analysed_by(answer("nothing-missing", []))
    run.run_foreign(request(tmp_path), [CASE])
    with pytest.raises(InputError, match="another draw, test"):
        run.run_foreign(replace(request(tmp_path), draw="other"), [CASE])
    with pytest.raises(InputError, match="another draw, test"):
        run.run_foreign(request(tmp_path), [CASE, replace(CASE, number=1)])


def test_a_truth_that_cannot_be_made_is_a_row_too(tmp_path, analysed_by, monkeypatch) -> None:
    def fails(case: Case) -> None:
        raise ArithmeticError("the truth cannot be integrated")

    monkeypatch.setattr(run, "make_case", fails)
    seen = analysed_by(answer("nothing-missing", []))
    [row] = run.run_foreign(request(tmp_path), [CASE])
    assert row["outcome"] == "no-answer" and "cannot be integrated" in str(row["problem"])
    assert not seen


def test_the_page_is_written_from_the_rows(tmp_path, analysed_by) -> None:
    analysed_by(answer("missing-term", [term("v", "v", -0.3)]))
    asked = request(tmp_path)
    with pytest.raises(InputError, match="no draw in this folder"):
        write_document(asked)
    run.run_foreign(asked, [CASE])
    write_document(asked)
    page = (tmp_path / "page.md").read_text()
    assert "1 of 1 cases are done" in page and "practice draw" in page
    assert "| mechanics-dry\\_friction-2pc-0 |" in page and "silent-wrong" in page
    assert (tmp_path / "page" / "test.jsonl").is_file()


def test_other_methods_are_asked_afterwards_and_once(tmp_path, analysed_by, monkeypatch) -> None:
    asked: list[tuple[str, float]] = []
    told = PeerRow(right=False, told="v: +1·v", seconds=2.0, problem=None)

    def ask(case: Case, made: MadeCase, limit: float) -> dict[str, PeerRow]:
        asked.append((case.name, limit))
        return {"filter": told}

    monkeypatch.setattr(run, "ask_peers", ask)
    seen = analysed_by(answer("nothing-missing", []))
    faulty = replace(CASE, kind="sensor", number=2)
    cases = [CASE, faulty]
    assert [row["peers"] for row in run.run_foreign(request(tmp_path), cases)] == [{}, {}]
    limited = replace(request(tmp_path), peer_limit=7)
    for _ in range(2):
        rows = run.run_foreign(limited, cases)
        assert [row["peers"] for row in rows] == [{"filter": told}, {}]
    assert asked == [(CASE.name, 7)] and len(seen) == 2
