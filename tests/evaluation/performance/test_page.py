"""The text of the page from rows whose law is known."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from dashred.core.errors import InputError
from dashred.core.findings.findings import canonical
from dashred.evaluation.performance.arguments import read_words
from dashred.evaluation.performance.document import figures, write_document
from dashred.evaluation.performance.page import BEGIN, END, check_page, write_between_marks
from tests.evaluation.performance.invented_rows import common, growth_row, stored

CHECKOUT = Path(__file__).resolve().parents[3]


def test_the_exponents_and_what_misses_its_goal() -> None:
    rows = [growth_row("grid", size) for size in (32, 64, 128)]
    rows += [growth_row("library", size) for size in (10, 20, 40)]
    text = figures(rows)
    assert (
        "| grid points | 1.00 ± 0.00 | 1.25 ± 0.00 | 0.00 ± 0.00 | 3.00 ± 0.00 | ≤ 1.1 | "
        "400 + 2 n (within 0 %) |"
    ) in text
    assert "\n- columns over grid points: exponent 1.25, goal 1.1\n" in text
    assert "- selection over terms of the library: exponent 3.00, goal 0.3" in text
    # The columns are apart there.
    assert "columns over terms" not in text
    assert "march over grid points" not in text


def test_the_distance_from_the_floor() -> None:
    text = figures([growth_row("grid", 64)])
    # 4.096 s over 80 steps, and 4096^1.25 ms over 320 steps, over a floor of 1 ms.
    assert "| 64² | march | 2 | 3 | 1000 | 51200 | 51.2 |" in text
    assert "| 64² | columns | 2 | 3 | 1000 | 102000 | 102.4 |" in text
    assert "- march on 64²: 51.2 times the floor, goal 5" in text
    # 5/2 · 4096 · 12 operations in 50 and 25 µs.
    assert "| 64² | 50 | 25 | 2.46 | 4.92 | 20 | 40 |" in text


def test_the_efficiency_of_workers() -> None:
    seconds = {1: 16.0, 2: 8.0, 4: 5.0}
    case = {"kind": "waits", "cases": 16}
    rows = [common("jobs", n) | case | {"seconds": found} for n, found in seconds.items()]
    rows.append(common("cluster", 2) | case | {"seconds": 10.0, "start": 3.0})
    text = figures(rows)
    assert "| jobs= | 2 | 16 cases, each waits | 8 | 2.00 | 1.00 |  |" in text
    assert "| jobs= | 4 | 16 cases, each waits | 5 | 3.20 | 0.80 |  |" in text
    assert "| cluster= | 2 | 16 cases, each waits | 10 | 2.00 | 1.00 | 3 |" in text
    assert "Goals that are missed" not in text
    slow = [*rows[:2], common("jobs", 4) | case | {"seconds": 6.0}]
    assert "- jobs= with 4 workers: efficiency 0.67, goal 0.8" in figures(slow)
    columns = {"kind": "waits", "cases": 216}
    pairs = {1: 6.0, 4: 3.0}
    divided = [common("columns", n) | columns | {"seconds": found} for n, found in pairs.items()]
    text = figures(divided)
    assert "| cluster=, one Jacobian | 4 | 216 columns, each waits | 3 | 2.00 | 0.50 |  |" in text
    assert "- cluster=, one Jacobian with 4 workers: efficiency 0.50, goal 0.6" in text


def test_the_stages_of_whole_analyses_longest_first() -> None:
    first = {"select the law": 3.0, "train SHRED": 5.0, "in all": 10.0}
    second = {"select the law": 30.0, "in all": 60.0}
    rows = [common("stages", name) | {"seconds": found} for name, found in
            (("rde", first), ("ks2d", second))]  # fmt: skip
    lines = figures(rows).splitlines()
    at = lines.index("| stage | rde, s | ks2d, s |")
    assert lines[at + 2 : at + 5] == [
        "| select the law | 3 (30 %) | 30 (50 %) |",
        "| train SHRED | 5 (50 %) |  |",
        "| in all | 10 | 60 |",
    ]


def test_parts_that_were_not_measured_are_not_there() -> None:
    text = figures([growth_row("sensors", size) for size in (8, 16)])
    assert "### Growth" in text
    for title in ("Distance from the limit", "More workers", "Stages"):
        assert title not in text


def test_the_rest_of_the_page_stays(tmp_path: Path) -> None:
    page = tmp_path / "performance.md"
    page.write_text(f"# Before\n\n{BEGIN}\n\nold\n\n{END}\n\n## On a GPU\n")
    write_between_marks(page, "new")
    assert page.read_text() == f"# Before\n\n{BEGIN}\n\nnew\n\n{END}\n\n## On a GPU\n"


def test_the_page_of_the_checkout_has_a_place_for_the_figures() -> None:
    check_page(CHECKOUT / "docs" / "performance.md")


def test_the_rows_are_beside_the_page(tmp_path: Path) -> None:
    output, page = tmp_path / "rows", tmp_path / "page.md"
    rows = [growth_row("sensors", size) for size in (8, 16)]
    stored(output, *rows)
    write_document(read_words([f"output={output}", f"document={page}"]))
    assert page.read_text().startswith("# Performance\n")
    lines = page.with_suffix(".jsonl").read_text().splitlines()
    assert [json.loads(line) for line in lines] == canonical(rows)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("page.md", "# Performance\n", "no place for the figures"),
        ("page.md", f"{END}\n{BEGIN}\n", "no place for the figures"),
        ("missing/page.md", None, "no such folder"),
    ],
)
def test_a_page_without_marks_is_refused(
    tmp_path: Path, name: str, content: str | None, message: str
) -> None:
    if content is not None:
        (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=message) as caught:
        check_page(tmp_path / name)
    assert caught.value.hint
