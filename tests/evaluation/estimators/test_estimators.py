"""The table of estimators: its words, its page, and a row from a recording to its ratios."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from dashred.__main__ import main
from dashred.core.errors import DONE, InputError
from dashred.core.findings.findings import write_json_atomic
from dashred.evaluation.case_rows import read_rows
from dashred.evaluation.estimators import run
from dashred.evaluation.estimators.arguments import read_words
from dashred.evaluation.estimators.document import document
from dashred.evaluation.estimators.rows import Errors, Row, ratio
from dashred.evaluation.isolation.analysis import Analysis, Answer


def row_of(**changes: Any) -> Row:
    row = Row(
        system="heat",
        twin="a",
        seed=3,
        noise=0.01,
        budget=None,
        verdict="missing-term",
        exact=True,
        problem=None,
        filter=Errors(whole=0.02, settled=0.004),
        filter_settings="1000 members",
        shred=Errors(whole=0.06, settled=0.06),
        observer=Errors(whole=0.03, settled=0.006),
        covered=0.9,
        milliseconds=0.4,
    )
    row.update(changes)  # type: ignore[typeddict-item]
    return row


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["estimators"], "which action"),
        (["estimators", "rnu"], "no action 'rnu'"),
        (["estimators", "run", "systems=heta"], "no bundled system 'heta'"),
        (["estimators", "run", "noise=little"], "little"),
        (["estimators", "run", "members=1"], "not between"),
    ],
)
def test_a_mistake_is_told(words: list[str], message: str) -> None:
    with pytest.raises(InputError) as caught:
        main(["evaluate", *words])
    assert message in f"{caught.value.what} {caught.value.hint}"


def test_ratios_are_those_to_the_filter() -> None:
    row = row_of()
    assert ratio(row, "observer", "whole") == pytest.approx(1.5)
    assert ratio(row, "shred", "settled") == pytest.approx(15)
    assert ratio(row_of(filter=None), "observer", "whole") is None
    assert ratio(row_of(observer=None), "observer", "whole") is None


def test_the_page_counts_what_is_near_and_names_what_failed() -> None:
    far = row_of(system="wave", observer=Errors(whole=0.05, settled=0.05), covered=0.7)
    lost = row_of(system="rde", problem="no answer within 9 s", filter=None, observer=None)
    lost.update({"covered": None, "milliseconds": None, "shred": None, "verdict": None})
    text = document([row_of(), far, lost])
    assert "in 1/2 = 50 %" in text and "Rows: 3." in text
    assert "at most twice as much in 1/2" in text and "largest ratio is 2.5" in text
    assert "80 % of the values in the median" in text and "70 % at least" in text
    assert "no answer within 9 s" in text


def test_no_rows_are_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no rows"):
        main(["evaluate", "estimators", "document", f"output={tmp_path}"])


def test_an_analysis_without_an_answer_is_a_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Analysis] = []

    def analyse(analysis: Analysis) -> Answer:
        seen.append(analysis)
        return Answer(9.0, 9.0, "no answer within 9 s", b"", lost=True)

    monkeypatch.setattr(run, "analyse", analyse)
    words = ["run", "systems=mass_spring", "seeds=7", "limit=9", "budget=8"]
    request = read_words(["estimators", *words, f"output={tmp_path / 'out'}"])
    run.run_estimators(request)
    [row] = read_rows(request.output)
    assert row["problem"] == "no answer within 9 s" and row["filter"] is None
    [analysis] = seen
    assert list(analysis.files) == ["recording.nc"] and analysis.limit == 9
    assert "budget=8" in analysis.words and not any("twin" in word for word in analysis.words)
    run.run_estimators(request)
    assert len(seen) == 1


@pytest.mark.slow
def test_the_observer_comes_near_to_the_filter_on_the_true_law(tmp_path: Path) -> None:
    output, page = tmp_path / "out", tmp_path / "page.md"
    words = ["systems=mass_spring", "seeds=5", "members=200", "budget=600", f"output={output}"]
    assert main(["evaluate", "estimators", "run", *words]) == DONE
    [row] = read_rows(output)
    found = ratio(row, "observer", "whole")
    assert row["exact"] and found is not None and found < 1.5
    assert row["covered"] is not None and row["covered"] > 0.7
    write_json_atomic(output / "rows" / "other.json", row)
    words = [f"output={output}", f"document={page}"]
    assert main(["evaluate", "estimators", "document", *words]) == DONE
    assert "Rows: 2." in page.read_text() and page.with_suffix(".jsonl").is_file()
