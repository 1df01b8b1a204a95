"""The page of all rows, ``docs/estimators.md``."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

from dashred.core.templates import render
from dashred.evaluation.estimators.rows import Errors, Row, ratio
from dashred.evaluation.proof.scoring.statistics import Rate

TEMPLATE = "evaluation/estimators/templates/estimators.md.j2"
# Largest ratio to the error of the filter that is aimed at, and one that is aimed at everywhere.
NEAR, EVERYWHERE = 1.5, 2.0


def document(rows: Sequence[Row]) -> str:
    """Return the page as Markdown."""
    found = [r for row in rows if (r := ratio(row, "observer", "whole")) is not None]
    covered = [row["covered"] for row in rows if row["covered"] is not None]
    return render(
        TEMPLATE,
        count=len(rows),
        near=str(Rate.of(r <= NEAR for r in found)),
        everywhere=str(Rate.of(r <= EVERYWHERE for r in found)),
        largest=f"{max(found):.2g}" if found else "none",
        covered=f"{100 * median(covered):.0f} %" if covered else "none",
        least=f"{100 * min(covered):.0f} %" if covered else "none",
        lines=[_line(row) for row in rows],
    )


def _line(row: Row) -> list[str]:
    return [
        row["system"],
        row["twin"],
        str(row["seed"]),
        f"{100 * row['noise']:g} %",
        row["problem"] or row["verdict"] or "",
        {True: "exact", False: "not exact", None: "no law"}[row["exact"]],
        row["filter_settings"],
        _text(row["filter"]),
        _text(row["shred"]),
        _ratio(row, "shred"),
        _text(row["observer"]),
        _ratio(row, "observer"),
        "" if row["covered"] is None else f"{100 * row['covered']:.0f} %",
        "" if row["milliseconds"] is None else f"{row['milliseconds']:.2g}",
    ]


def _text(errors: Errors | None) -> str:
    return "none" if errors is None else f"{errors['whole']:.2g} ({errors['settled']:.2g})"


def _ratio(row: Row, name: str) -> str:
    whole, settled = ratio(row, name, "whole"), ratio(row, name, "settled")
    return "" if whole is None or settled is None else f"{whole:.2g} ({settled:.2g})"
