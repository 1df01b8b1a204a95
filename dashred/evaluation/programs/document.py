"""The page of all rows, ``docs/programs.md``."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

from dashred.core.templates import render
from dashred.evaluation.programs.rows import Answer, Row
from dashred.evaluation.proof.scoring.statistics import Rate

TEMPLATE = "evaluation/programs/templates/programs.md.j2"
# A coefficient may differ from the true one by so many of its std.
STDS = 2.0


def document(rows: Sequence[Row]) -> str:
    """Return the page as Markdown."""
    deviations = [row["program"]["deviation"] for row in rows]
    ratios = [row["program"]["seconds"] / row["equations"]["seconds"] for row in rows]
    return render(
        TEMPLATE,
        count=len(rows),
        exact_program=str(Rate.of(row["program"]["exact"] is True for row in rows)),
        exact_equations=str(Rate.of(row["equations"]["exact"] is True for row in rows)),
        within=str(Rate.of(None if d is None else d <= STDS for d in deviations)),
        median_ratio=f"{median(ratios):.3g}",
        largest_ratio=f"{max(ratios):.3g}",
        lines=[_line(row) for row in rows],
    )


def _line(row: Row) -> list[str]:
    program, equations = row["program"], row["equations"]
    return [
        row["system"],
        row["twin"],
        str(row["seed"]),
        "" if row["budget"] is None else str(row["budget"]),
        program["problem"] or program["verdict"] or "",
        _exact(program),
        "" if program["error"] is None else f"{100 * program['error']:.2g} %",
        "" if program["deviation"] is None else f"{program['deviation']:.2g}",
        _exact(equations),
        str(row["calls"]),
        str(row["states"]),
        f"{program['seconds']:.0f}",
        f"{row['seconds_inside']:.0f}",
        f"{equations['seconds']:.0f}",
        f"{program['seconds'] / equations['seconds']:.2g}",
    ]


def _exact(answer: Answer) -> str:
    return {True: "exact", False: "not exact", None: "no law"}[answer["exact"]]
