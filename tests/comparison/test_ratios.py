"""What rows of a comparison come to."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from dashred.comparison.document import write_results
from dashred.comparison.method_scores import Compared
from dashred.comparison.ratios import ComparedRow, as_metrics, count_laws, median_ratio


def method(rmse: float | None, law: tuple[int, int, int, float | None] | None) -> Compared:
    found, spurious, missed, error = law or (None, None, None, None)
    return Compared(
        rmse=rmse,
        found=found,
        spurious=spurious,
        missed=missed,
        coefficient_error=error,
        seconds=1.0,
        note="",
    )


def row(twin: str, corrected: float, law: tuple[int, int, int, float | None]) -> ComparedRow:
    record: dict[str, Any] = {
        "system": "rde",
        "twin": twin,
        "noise": 0.01,
        "seed": 0,
        "sensors": None,
        "extra": None,
        "flagged": False,
        "null": twin == "null",
        "law": twin != "null",
        "problem": None,
        "verdict": "missing-term",
        "terms": [
            {"equation": "u", "term": "u", "coefficient": -0.04, "std": 0.001, "region": None}
        ],
        "exact_support": not law[1] and not law[2],
        "coefficient_error": law[3],
        "field_rmse": {"corrected": corrected},
        "ratios": dict.fromkeys(
            (
                "corrected/simulation_same_start",
                "corrected/simulation_refit",
                "corrected_shred/dashred",
            )
        ),
        "forecast": {},
        "seconds": {"in all": 60.0},
        "git_commit": "0123abc",
    }
    methods = {
        "simulation_same_start": method(0.5, None),
        "corrected": method(corrected, law),
        "pde_find": method(None, (1, 2, 0, 0.3)),
    }
    return ComparedRow(record, methods, Path("/nowhere"))


ROWS = [
    row("a", 0.05, (1, 0, 0, 0.01)),
    row("b", 0.02, (2, 1, 1, 0.03)),
    row("null", 0.5, (0, 0, 0, None)),
]


def test_a_null_has_no_part_in_the_ratios_but_counts_among_the_laws() -> None:
    assert median_ratio(ROWS, "corrected") == pytest.approx((0.1 + 0.04) / 2)
    assert median_ratio(ROWS, "pde_find") is None
    count = count_laws(ROWS, "corrected")
    assert count is not None
    assert (count.rows, count.exact, count.found, count.spurious, count.missed) == (3, 2, 3, 1, 1)
    assert count.error == pytest.approx(0.02)
    assert count_laws(ROWS, "simulation_same_start") is None


def test_metrics_are_named_by_system_noise_and_method() -> None:
    found = as_metrics(ROWS)
    assert found == {
        "rde/noise 0.01/ratio/simulation_same_start": 1.0,
        "rde/noise 0.01/ratio/corrected": pytest.approx(0.07),
    }


def test_sensors_and_noise_have_a_table_of_their_own(tmp_path: Path) -> None:
    few = row("a", 0.4, (0, 1, 1, None))
    few.record.update(sensors=4, extra=0)
    write_results([*ROWS, few], tmp_path / "results.md")
    text = (tmp_path / "results.md").read_text()
    assert "| 4, 0 | exact 0 of 1; wrong and unflagged 1; corrected × 0.8 |" in text
    assert "2 of 3" in text


def test_the_page_tells_the_paper_beside_us(tmp_path: Path) -> None:
    page = tmp_path / "results.md"
    write_results(ROWS, page)
    text = page.read_text()
    [line] = [line for line in text.splitlines() if line.startswith("| rde | 1 % |")]
    assert "about 10×" in line and "2 of 3" in line and "14.3×" in line
    assert "| PDE-FIND, given the full noisy field | 0 of 3 | 3 | 6 | 0 | 30 % |" in text
    assert "Code: 0123abc." in text
