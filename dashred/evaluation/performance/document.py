"""The measured figures as text, written into the page."""

from __future__ import annotations

from collections.abc import Sequence

from dashred.core.errors import InputError
from dashred.core.progress import CONSOLE
from dashred.core.templates import render
from dashred.evaluation.json_lines import write_rows_beside
from dashred.evaluation.performance.arguments import Request
from dashred.evaluation.performance.growth_tables import (
    exponents_table,
    growth_tables,
    missed_goals,
)
from dashred.evaluation.performance.limit_tables import floor_table, missed_floors, rates_table
from dashred.evaluation.performance.page import write_between_marks
from dashred.evaluation.performance.rows import Row, read_rows
from dashred.evaluation.performance.speed_up_table import missed_efficiencies, speed_up_table
from dashred.evaluation.performance.stages_table import stages_table

TEMPLATE = "evaluation/performance/templates/performance.md.j2"


def write_document(request: Request) -> None:
    """Write the figures into the page, and the rows beside it as JSON lines.

    Raises:
        InputError: there are no rows.
    """
    rows = read_rows(request.output)
    if not rows:
        hint = "give the same command again; what it printed above says why they failed"
        raise InputError("no row was measured", where=str(request.output), hint=hint)
    write_rows_beside(request.document, rows)
    write_between_marks(request.document, figures(rows))
    CONSOLE.print(f"Document: {request.document}", markup=False, soft_wrap=True)


def figures(rows: Sequence[Row]) -> str:
    """Return the figures as Markdown."""
    return render(
        TEMPLATE,
        machine=rows[0]["machine"],
        commits=_distinct(rows, "git_commit"),
        dates=_distinct(rows, "date"),
        repeats=max(row["repeats"] for row in rows),
        missed=[*missed_goals(rows), *missed_floors(rows), *missed_efficiencies(rows)],
        growths=growth_tables(rows),
        exponents=exponents_table(rows),
        rates=rates_table(rows),
        floors=floor_table(rows),
        speed_up=speed_up_table(rows),
        stages=stages_table(rows),
    )


def _distinct(rows: Sequence[Row], name: str) -> list[str]:
    return sorted({str(row[name]) for row in rows})
