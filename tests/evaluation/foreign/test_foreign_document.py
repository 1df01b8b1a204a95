"""The page: shares with intervals, every failure, and a section for each draw."""

from __future__ import annotations

import re

import pytest

from dashred.core.errors import InputError
from dashred.evaluation.foreign.document import document, in_order, read_stored, store_draw
from dashred.evaluation.foreign.draw_file import Draw
from dashred.evaluation.foreign.peers.methods import GIVEN
from dashred.evaluation.foreign.rows import PeerRow, Row
from dashred.evaluation.foreign.score_case import LARGEST_GAIN, gain
from dashred.evaluation.foreign.tables import (
    detail_table,
    outcome_table,
    peer_problems,
    peer_tables,
    percentile,
)
from tests.evaluation.foreign.invented import row


def facts(name: str, cases: int, *, practice: bool = False) -> Draw:
    return Draw(
        name=name,
        draw="0123abcd",
        practice=practice,
        cases={"dysts": cases},
        limit=900,
        peer_limit=120,
        versions={"dysts": "0.95"},
    )


OUTCOMES = ["right"] * 6 + ["listed", "flagged", "silent-wrong", "no-answer"]
ROWS: list[Row] = [row(f"s{i}", outcome=outcome) for i, outcome in enumerate(OUTCOMES)]


def test_outcomes_are_shares_with_wilson_intervals() -> None:
    lines = {line[0]: line[1:] for line in outcome_table(ROWS)}
    assert lines["all"] == lines["polynomial systems of dysts, 2 % noise"]
    assert lines["all"][0] == "10"
    assert lines["all"][1] == "6/10 = 60 % (31-83 %)"
    assert lines["all"][2].startswith("7/10 = 70 %")
    assert [cell[:4] for cell in lines["all"][3:]] == ["1/10"] * 4


def test_noises_and_kinds_have_lines_of_their_own() -> None:
    rows = [row("a"), row("a", noise=0.05), row("b", collection="fields", kind="source")]
    names = [line[0] for line in outcome_table(rows)]
    assert "polynomial systems of dysts, 5 % noise" in names
    assert "fields and mechanics: a localised source" in names and "system: b" in names


def test_details_count_what_is_asked() -> None:
    rows = [
        row("a", kind="source", located=True),
        row("b", kind="source", located=None, outcome="no-answer"),
        row("c", kind="nothing", outcome="silent-wrong", verdict="missing-term"),
        row("d", kind="nothing", outcome="no-answer", verdict=None),
        row("e", kind="sensor", probability=0.95, leading_right=False, covered=[False, True]),
    ]
    lines = dict(detail_table(rows))
    assert lines["sources located: the peak is inside"].startswith("1/2")
    assert lines["false alarms where nothing is hidden"].startswith("1/1")
    assert lines["leading cause right, stated probability 0.9 to 0.98"].startswith("0/1")
    assert lines["95 % intervals that cover"].startswith("5/6")


def test_a_simulation_that_diverges_counts_as_the_largest_gain() -> None:
    assert gain({"simulation_refit": None, "corrected": 0.1}) == LARGEST_GAIN
    assert gain({"simulation_refit": 0.6, "corrected": 0.1}) == pytest.approx(6.0)
    assert gain({"simulation_refit": 0.6, "corrected": None}) is None
    assert gain({}) is None


def test_gains_of_forecasts_are_told() -> None:
    rows = [row("a", gain_forecast=50.0), row("b", gain_forecast=0.5), row("c")]
    lines = dict(detail_table(rows))
    [name] = [each for each in lines if "forecast" in each]
    assert "median of 2" in name and lines[name].startswith("25.2; 1/2")


def peer(right: bool | None, problem: str | None = None) -> PeerRow:
    versions = {"scipy": "1.17.1"}
    return PeerRow(right=right, told="", seconds=1.0, problem=problem, versions=versions)


PEER_ROWS = [
    row("a", peers={"weak_sindy": peer(True), "filter": peer(None, "lost"), "oracle": peer(True)}),
    row("b", outcome="flagged", peers={"weak_sindy": peer(False), "filter": peer(None, "lost")}),
    row("c"),
]


def test_methods_that_are_given_the_same_stand_beside_the_same_cases() -> None:
    tables = {table["given"]: table for table in peer_tables(PEER_ROWS)}
    assert list(tables) == [GIVEN["past"], GIVEN["full state"], GIVEN["form"]]
    full = tables[GIVEN["full state"]]
    assert full["header"] == ["", "n", "dashred", "PySINDy, weak form"]
    name, asked, ours, weak = full["lines"][-1]
    assert (name, asked) == ("all", "2") and ours.startswith("1/2") and weak.startswith("1/2")
    # The method that is told the true terms was asked about one case, and so dashred counts there.
    _, asked, ours, best = tables[GIVEN["form"]]["lines"][-1]
    assert asked == "1" and ours.startswith("1/1") and best.startswith("1/1")


def test_the_reason_for_no_answer_and_the_versions_are_told() -> None:
    lines = {line[0]: line[1:] for line in peer_problems(PEER_ROWS)}
    [filtered] = [cells for name, cells in lines.items() if "filter" in name]
    assert filtered == ["0", "0", "2", "1", "lost"]
    page = document([(facts("v1", 10), PEER_ROWS)])
    assert f"Given {GIVEN['form']}:" in page and "Packages: scipy 1.17.1." in page
    assert not re.search(r"\n\n\n", page)


@pytest.mark.parametrize(("count", "expected"), [(1, 0), (20, 18), (100, 94), (40, 37)])
def test_the_95th_percentile_is_a_measured_value(count: int, expected: int) -> None:
    assert percentile(range(count), 0.95) == expected


def test_every_case_that_is_not_right_is_listed() -> None:
    page = document([(facts("v1", 10), ROWS)])
    for each in ROWS:
        listed = f"| {each['case'].replace('_', chr(92) + '_')} |" in page
        assert listed == (each["outcome"] != "right")
    assert "4 of 10 cases are not right" in page


def test_the_newest_tag_comes_first_and_an_incomplete_draw_says_so() -> None:
    page = document([(facts("v1", 10), ROWS), (facts("v2", 12), ROWS)])
    assert page.index("## Tag v2") < page.index("## Tag v1")
    lines = [line for line in page.split("## Tag")[0].splitlines() if line.startswith("| v")]
    assert [line.split(" | ")[:3] for line in lines] == [
        ["| v2", "10 of 12", "6/10 = 60 % (31-83 %)"],
        ["| v1", "10 of 10", "6/10 = 60 % (31-83 %)"],
    ]
    assert page.count("The draw is incomplete") == 1
    assert "practice" not in page.split("## Protocol")[0]
    assert not re.search(r"\n\n\n", page)


def test_stored_rows_are_read_back(tmp_path) -> None:
    path = tmp_path / "v1.jsonl"
    store_draw(path, facts("v1", 10), ROWS)
    assert read_stored(path) == (facts("v1", 10), ROWS)
    path.write_text(path.read_text()[:-20])
    with pytest.raises(InputError, match="does not hold the rows"):
        read_stored(path)


def test_the_tenth_draw_is_newer_than_the_second(tmp_path) -> None:
    for name in ("foreign-10", "foreign-2", "foreign-1"):
        (tmp_path / f"{name}.jsonl").touch()
    assert [path.stem for path in in_order(tmp_path)] == ["foreign-1", "foreign-2", "foreign-10"]
