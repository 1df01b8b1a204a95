"""The page: all targets, all classes, all failures, and tables that are tables."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from dashred.evaluation.proof.cases.case_record import CaseRecord
from dashred.evaluation.proof.document import document, write_document
from dashred.evaluation.proof.figures import FIGURES
from dashred.evaluation.proof.protocol import ProtocolFacts
from dashred.evaluation.proof.scoring.outcomes import shortcomings
from dashred.evaluation.proof.scoring.targets import TARGETS
from tests.evaluation.proof.invented import case, dead, null, proof, wrong

FACTS = ProtocolFacts(
    commit="0123abc",
    draw="0123abc",
    seed=77,
    cases=120,
    nulls=100,
    hours=5.25,
    processes=2,
    drawn_again=4,
    scored_by=None,
)


def table(page: str, heading: str) -> list[list[str]]:
    """Return the cells of the first table below a heading, without its header."""
    below = page.split(f"\n## {heading}\n")[1]
    lines = below[below.index("\n|") + 1 :].split("\n\n")[0].splitlines()
    return [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines[2:]]


def test_every_target_has_its_line() -> None:
    page = document([case(number, right=number > 0) for number in range(6)], FACTS)
    lines = {line[0].partition(" (")[0]: line[1:] for line in table(page, "Targets")}
    assert set(lines) == {target.name for target in TARGETS}
    assert "The number of redraws was 4" in " ".join(page.split())
    assert lines["verdict right"] == ["83 %", "6", "44-97 %", "≥ 80 %", "met"]
    assert lines["hidden field: right equation"] == ["", "0", "", "≥ 90 %", "no data"]
    assert lines["95 % intervals that cover"][3:] == ["90-98 %", "not met"]
    assert lines["seconds of an fhn case, mean"] == ["61.2 s", "6", "", "≤ 90 s", "met"]
    assert lines["gain of the forecast, median"][3] == "≥ 10×"
    assert lines["coefficients within 5 % or 3 std"][3] == "all"


def test_every_case_that_falls_short_is_listed_with_what_was_hidden_and_told() -> None:
    records = proof()
    page = document(records, FACTS)
    below = page.split("\n## Shortcomings\n")[1].split("\n## ")[0]
    listed = re.findall(r"^\| ((?:case|null) \d+):", below, flags=re.MULTILINE)
    failed = [r for r in records if shortcomings(r)]
    assert listed == [f"{r['group'][:-1]} {r['number']}" for r in failed]
    assert 10 < len(failed) < 60
    assert f"{len(failed) - 1} of 120 cases have shortcomings" in below
    assert "1 of 100 nulls have shortcomings" in below


def test_a_failure_reads_in_one_line() -> None:
    bad = wrong(17, "box", hidden="u: -0.15*u**2\nfor u|v <b>", told="b is 0.7", probability=0.93)
    [[about, hidden, told, what]] = table(document([bad, case()], FACTS), "Shortcomings")
    assert about == "case 17: fhn, a term in a region, noise 3 %, 12 sensors, effect 4.2 σ"
    assert hidden == r"u: -0.15\*u\*\*2 for u\|v \<b>"
    assert told == "b is 0.7 (leading cause: parameter, 0.93)"
    assert what == "wrong and unflagged"


def test_a_case_that_died_is_listed_without_a_verdict() -> None:
    [[_, _, told, what]] = table(document([dead(4)], FACTS), "Shortcomings")
    assert (told, what) == ("", "failed: exit code -9")


def test_classes_are_scored_alone_and_pooled() -> None:
    records = [case(kind="start"), wrong(1, "fault"), case(2, "numerics", oracle=None), null()]
    lines = {
        line[0]: line[1:] for line in table(document(records, FACTS), "By kind of hidden effect")
    }
    assert lines["a faulty sensor"][:2] == ["1", "0/1 = 0 % (0-79 %)"]
    assert lines["pooled: start, numerics, sensor"][1].startswith("2/3 = 67 %")
    assert lines["pooled: start, numerics, sensor"][4].startswith("2/2 ")
    assert lines["all cases"][0] == "3" and lines["nulls, separately"][0] == "1"
    assert "missing terms" not in lines


def test_calibration_tells_what_was_stated_and_what_came_of_it() -> None:
    records = [case(n, probability=0.8 if n < 4 else 0.95, right=n != 0) for n in range(10)]
    records[0] |= {"causes": ["parameter"]}
    lines = {line[0]: line[1:] for line in table(document(records, FACTS), "Calibration")}
    stated = lines["leading cause, probability 0.7 to 0.9"]
    assert stated == ["75 %", "4", "30-95 %", "80 %, the mean stated"]
    assert lines["95 % intervals, terms everywhere; rms of z: 1"][:2] == ["100 %", "10"]
    assert lines["95 % intervals, terms in a region"][:2] == ["", "0"]


@pytest.mark.parametrize("records", [[], [case()], [null()], [dead()], proof()])
def test_every_table_has_as_many_cells_in_every_line(records: list[CaseRecord]) -> None:
    page = document(records, FACTS)
    for block in re.findall(r"(?:^\|.*\n)+", page, flags=re.MULTILINE):
        widths = {len(re.split(r"(?<!\\)\|", line)) for line in block.splitlines()}
        assert len(widths) == 1
    assert "nan" not in page and "None" not in page


def test_the_protocol_tells_its_facts_and_the_headline_counts() -> None:
    page = document([], FACTS)
    for fact in ("0123abc", "77", "120 cases", "100 nulls", "Finished: 0", "5.2 h", "2 processes"):
        assert fact in page
    assert f"0 of {len(TARGETS)} targets are met, 0 missed, and {len(TARGETS)} have no data" in page


def test_the_page_shows_every_figure_that_is_drawn() -> None:
    links = re.findall(r"!\[[^\]]+\]\(figures/(proof_\w+\.png)\)", document([], FACTS))
    assert sorted(links) == sorted(FIGURES)


def test_a_page_is_written_whole_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "proof.md"
    write_document([case()], path, FACTS)
    before = path.read_text(encoding="utf-8")
    assert before == document([case()], FACTS)

    def full(*_: object, **__: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OSError, match="no space"):
        write_document([wrong()], path, FACTS)
    assert [file.name for file in tmp_path.iterdir()] == ["proof.md"]
    assert path.read_text(encoding="utf-8") == before


def test_an_appendix_stands_at_the_end(tmp_path) -> None:
    path = tmp_path / "proof.md"
    write_document([case()], path, FACTS, "## Appendix: a real recording\n")
    assert path.read_text().endswith("\n\n## Appendix: a real recording\n")


def test_a_draw_for_practice_is_not_passed_off_as_the_proof() -> None:
    practice = replace(FACTS, commit=None, draw="mine")
    assert "this is a practice draw, not the proof" in document([case()], practice)
    page = document([case()], FACTS)
    assert "Rescored by" not in page
    assert "Rescored by commit 4567def" in document([case()], replace(FACTS, scored_by="4567def"))
    assert "practice" not in page and "the commit under test (0123abc)" in page
    assert "4 to 40 (`fhn`) or 20 to 100 (`rde`)" in " ".join(page.split())
