"""What rows of a comparison come to."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from dashred.evaluation.comparison.comparison_file import MethodScore
from dashred.evaluation.comparison.document import write_results
from dashred.evaluation.comparison.outcomes import count_claims
from dashred.evaluation.comparison.ratios import (
    LAWS,
    ComparedRow,
    FieldRatio,
    as_metrics,
    count_laws,
    field_ratio,
)


def method(
    rmse: float | None,
    law: tuple[int, int, int, float | None] | None,
    failed: str | None = None,
    note: str = "",
) -> MethodScore:
    found, spurious, missed, error = law or (None, None, None, None)
    return MethodScore(
        rmse=rmse,
        exact=None if law is None else not spurious and not missed,
        found=found,
        spurious=spurious,
        missed=missed,
        coefficient_error=error,
        seconds=1.0,
        note=note,
        failed=failed,
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
        "verdict": "nothing-missing" if twin == "null" else "missing-term",
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


def died(twin: str) -> ComparedRow:
    """A row of which the analysis crashed."""
    kept = row(twin, 0.1, (0, 0, 0, None)).record
    known = ("system", "twin", "noise", "seed", "sensors", "extra", "null", "law")
    problem = "ValueError: no horizon"
    record = {key: kept[key] for key in known} | {"problem": problem, "exit_code": 1}
    return ComparedRow(record, {}, Path("/nowhere"), problem)


def ratio_of(rows: list[ComparedRow], name: str) -> FieldRatio:
    found = field_ratio(rows, name)
    assert found is not None
    return found


def test_a_null_has_no_part_in_the_ratios_but_counts_among_the_laws() -> None:
    assert ratio_of(ROWS, "corrected").median == pytest.approx((0.1 + 0.04) / 2)
    assert ratio_of(ROWS, "pde_find").median is None
    count = count_laws(ROWS, "corrected")
    assert count is not None
    assert (count.rows, count.exact, count.found, count.spurious, count.missed) == (3, 2, 3, 1, 1)
    assert count.error == pytest.approx(0.02)
    assert count_laws(ROWS, "simulation_same_start") is None


def test_a_twin_with_another_fault_than_of_its_law_has_no_part_in_the_ratios() -> None:
    fault = row("f", 0.5, (0, 0, 0, None))
    fault.record.update(null=False, law=False)
    assert ratio_of([*ROWS, fault], "corrected") == ratio_of(ROWS, "corrected")


def test_an_analysis_that_died_is_lost_and_not_exact(tmp_path: Path) -> None:
    rows = [*ROWS, died("b"), died("b")]
    assert ratio_of(rows, "corrected") == FieldRatio(float("inf"), 4, 2)
    # The reference has its own two rows: it did not get as far in the others.
    assert ratio_of(rows, "simulation_same_start") == FieldRatio(1.0, 2, 0)
    count = count_laws(rows, "corrected")
    assert count is not None and (count.rows, count.exact, count.failed) == (5, 2, 2)
    others = count_laws(rows, "pde_find")
    assert others is not None and (others.rows, others.failed) == (3, 0)
    claims = count_claims(rows)
    assert (claims.laws, claims.exact, claims.others, claims.right) == (4, 1, 1, 1)
    assert (claims.wrong_unflagged, claims.failed) == (1, 2)
    write_results(rows, tmp_path / "results.md")
    text = (tmp_path / "results.md").read_text()
    [line] = [line for line in text.splitlines() if line.startswith("| rde | 1 % |")]
    assert "| 1 of 4 |" in line and "| (lost 2 of 4) |" in line
    assert "| dashred: corrected simulator | (lost 2 of 4) |" in text
    assert "| rde | b | 0.01 | 0 | all | ValueError: no horizon |" in text


def test_a_method_that_failed_is_worst_and_named(tmp_path: Path) -> None:
    rows = [row("a", 0.05, (1, 0, 0, 0.01)), row("b", 0.02, (1, 0, 0, 0.01))]
    lost = "its field is not finite"
    rows[0].methods["filter_state"] = method(0.2, None)
    rows[1].methods["filter_state"] = method(None, None, lost)
    assert ratio_of(rows, "filter_state") == FieldRatio(float("inf"), 2, 1)
    rows[1].methods["filter_augmented"] = method(None, (0, 0, 1, None), "LinAlgError: singular")
    count = count_laws(rows, "filter_augmented")
    assert count is not None and (count.exact, count.failed, count.missed) == (0, 1, 1)
    for one in rows:
        one.methods["closed_form"] = method(None, None, None, "not for this system")
    assert field_ratio(rows, "closed_form") is None and count_laws(rows, "closed_form") is None
    write_results(rows, tmp_path / "results.md")
    text = (tmp_path / "results.md").read_text()
    assert f"| rde | b | 0.01 | 0 | {LAWS['filter_augmented']} | LinAlgError: singular |" in text
    assert f"| rde | b | 0.01 | 0 | ensemble Kalman filter | {lost} |" in text
    assert "| ensemble Kalman filter | (lost 1 of 2) |" in text
    seconds = text[text.index("## Seconds") :]
    assert "| ensemble Kalman filter | 1 |" in seconds
    assert "closed form of linear systems |" not in seconds


def test_what_is_not_converged_has_missed_everything() -> None:
    open_ = row("a", 0.4, (0, 0, 1, None))
    open_.record.update(verdict="not-converged", flagged=True, terms=None, exact_support=None)
    open_.methods["corrected"]["exact"] = False
    count = count_laws([open_], "corrected")
    assert count is not None and (count.rows, count.exact, count.missed) == (1, 0, 1)
    claims = count_claims([open_])
    assert (claims.exact, claims.wrong_unflagged, claims.failed) == (0, 0, 0)


def test_ambiguous_findings_that_list_the_truth_are_counted(tmp_path: Path) -> None:
    listing = replace(row("a", 0.05, (0, 1, 1, None)), listed=True)
    listing.record.update(verdict="ambiguous", flagged=True)
    claims = count_claims([*ROWS, listing])
    assert (claims.laws, claims.exact, claims.listed, claims.wrong_unflagged) == (3, 1, 1, 1)
    write_results([*ROWS, listing], tmp_path / "results.md")
    [line] = [
        line
        for line in (tmp_path / "results.md").read_text().splitlines()
        if line.startswith("| rde | 1 % |")
    ]
    assert "| 1 of 3 | 1 | 1 of 1 | 1 | 0 |" in line


def test_rows_of_several_commits_are_warned_of_above_the_tables(tmp_path: Path) -> None:
    write_results([*ROWS, replace(ROWS[0], git_commit="89ab")], tmp_path / "results.md")
    text = (tmp_path / "results.md").read_text()
    assert "Warning: these rows were run by 2 versions of the code: 0123abc, 89ab" in text
    assert text.index("Warning") < text.index("| ---")


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
    assert "| 4 | 0 | right 0 of 1; wrong and unflagged 1; corrected × 0.8 |" in text


def test_the_page_tells_the_paper_beside_us(tmp_path: Path) -> None:
    page = tmp_path / "results.md"
    write_results(ROWS, page)
    text = page.read_text()
    [line] = [line for line in text.splitlines() if line.startswith("| rde | 1 % |")]
    assert "about 10×" in line and "| 1 of 2 | 0 | 1 of 1 | 1 | 0 |" in line and "14.3×" in line
    assert "| rde | PDE-FIND, given the full noisy field | 0 of 3 | 0 | 3 | 6 | 0 | 30 % |" in text
    assert "Code: 0123abc." in text
