"""A page holds what several commands have left in a folder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from dashred.evaluation.benchmark.arguments import Request, read_words
from dashred.evaluation.benchmark.plan import Row, plan
from dashred.evaluation.comparison.comparison_file import write_failed_comparison
from dashred.evaluation.comparison.stored_rows import rows_of_document


def asked(output: Path, *words: str) -> tuple[Request, list[Row]]:
    request = read_words([f"output={output}", *words])
    return request, plan(request)


def keep(row: Row, **more: Any) -> None:
    """Leave the record of a row that is done."""
    row.folder.mkdir(parents=True, exist_ok=True)
    known = ("twin", "noise", "seed", "sensors", "extra")
    record = {name: getattr(row, name) for name in known}
    record |= {"key": row.key, "problem": None, "words": list(row.words)} | more
    (row.folder / "row.json").write_text(json.dumps(record))
    (row.folder / "findings.json").write_text("{}")
    write_failed_comparison(row.folder, "of this no page cares")


def test_rows_of_other_systems_seeds_and_layouts_are_on_the_page(tmp_path: Path) -> None:
    _, first = asked(tmp_path, "systems=rde", "twins=a", "seeds=0-1")
    _, layouts = asked(tmp_path, "systems=rde", "twins=a", "sensors=4", "noise=0.01")
    request, now = asked(tmp_path, "systems=heat", "twins=b,null")
    for row in (*first, *layouts):
        keep(row)
    page = rows_of_document(request, now)
    assert [(row.name, row.twin, row.noise, row.sensors, row.seed) for row in page] == [
        ("heat", "b", 0.05, None, 0),
        ("heat", "null", 0.05, None, 0),
        ("rde", "a", 0.01, 4, 0),
        ("rde", "a", 0.05, None, 0),
        ("rde", "a", 0.05, None, 1),
    ]
    for row in now:
        keep(row)
    again, rows = asked(tmp_path, "systems=rde", "twins=a", "seeds=0-1")
    assert rows_of_document(again, rows) == page


def test_a_row_that_was_not_compared_yet_is_no_failure_of_this_command(tmp_path: Path) -> None:
    _, [cut_short] = asked(tmp_path, "systems=rde", "twins=a")
    _, [died] = asked(tmp_path, "systems=rde", "twins=b")
    for row in (cut_short, died):
        keep(row, problem="error: blows up" if row is died else None)
        (row.folder / "compared.json").unlink()
    request, rows = asked(tmp_path, "systems=heat", "twins=b")
    assert rows_of_document(request, rows) == [*rows, died]


@pytest.mark.parametrize("change", ["overrides", "configuration", "no record"])
def test_rows_of_another_comparison_are_left_out(tmp_path: Path, change: str) -> None:
    words = ["systems=rde", "twins=a"]
    _, [row] = asked(tmp_path, *words, *(["threads=3"] if change == "overrides" else []))
    if change == "configuration":
        keep(row, key=row.key | {"config_sha256": "of an earlier file"})
    elif change == "no record":
        keep(row, twin="zz")
    else:
        keep(row)
    request, rows = asked(tmp_path, "systems=heat", "twins=b")
    assert rows_of_document(request, rows) == rows
