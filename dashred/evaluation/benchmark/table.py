"""Tables of a benchmark, for the terminal and as Markdown: rows and summaries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from dashred.core.findings.methods import current_names
from dashred.core.templates import render
from dashred.evaluation.benchmark.record import RATIOS, Record
from dashred.evaluation.benchmark.summary import Summary, commits, setting_text

if TYPE_CHECKING:
    from rich.table import Table as RichTable

SAME, REFIT, SHRED = RATIOS
ROWS = (
    *("system", "twin", "noise", "sensors", "seed", "verdict", "found", "exact"),
    "coefficient error",
    *("RMSE DA-SHRED", "RMSE corrected", "corrected / same start", "corrected / refit"),
    *("corrected SHRED / DA-SHRED", "forecast", "seconds"),
)
COUNTS = {
    "rows": "rows",
    "failed": "failed",
    "exact": "exact law",
    "exact_unflagged": "exact and unflagged",
    "wrong_unflagged": "wrong and unflagged",
    "right_flagged": "right but flagged",
    "not_converged": "not converged",
    "unanswered": "no law sought",
}
RATIO_NAMES = {
    SAME: "RMSE corrected / simulation, same start",
    REFIT: "RMSE corrected / simulation, best start",
    SHRED: "RMSE SHRED on the corrected / DA-SHRED",
}
NOTE = (
    "RMSE: error of the field over the fit window, in standard deviations. Forecast: error of the "
    "corrected simulation after the end of the recording. Exact: the law has exactly the true "
    "terms (for a twin that hides nothing: none). Flagged: ambiguous, not-converged, "
    "outside-library, unconfirmed or unresolved-numerics. Twins without a hidden law (nothing, a "
    "sensor fault or a distant start) are excluded from the coefficient errors and ratios of the "
    "summary. Numbers are medians, with the largest in brackets."
)


@dataclass(frozen=True)
class Grid:
    """A table of strings."""

    title: str
    header: Sequence[str]
    lines: Sequence[Sequence[str]]


def rows_grid(records: Sequence[Record]) -> Grid:
    """Return the table with one line per row."""
    return Grid("Rows", ROWS, [_line(record) for record in records])


def summary_grid(summaries: Sequence[Summary]) -> Grid:
    """Return the table with one column per system and noise."""
    header = ["", *(f"{s['system']}, {setting_text(s)}" for s in summaries)]
    lines = [[name, *(str(s[key]) for s in summaries)] for key, name in COUNTS.items()]
    lines.append(
        [
            "coefficient error",
            *(_median_and_worst(s["coefficient_error"], _share) for s in summaries),
        ]
    )
    for ratio, name in RATIO_NAMES.items():
        lines.append([name, *(_median_and_worst(s["ratios"][ratio], _number) for s in summaries)])
    lines.append(["seconds", *(_median_and_worst(s["seconds"], _seconds) for s in summaries)])
    return Grid("Summary", header, lines)


def to_rich(grid: Grid) -> RichTable:
    """Return the table for a terminal."""
    from rich.table import Table
    from rich.text import Text

    table = Table(title=grid.title, title_justify="left")
    for name in grid.header:
        table.add_column(Text(name), overflow="fold")
    for line in grid.lines:
        table.add_row(*map(Text, line))
    return table


def to_markdown(grids: Sequence[Grid], notes: Sequence[str]) -> str:
    """Return the tables and notes as Markdown."""
    return render("evaluation/benchmark/templates/bench.md.j2", grids=grids, notes=notes)


def notes(records: Sequence[Record]) -> list[str]:
    """Return the notes below the tables."""
    return [NOTE, *notes_on_code(commits(records))]


def notes_on_code(known: Sequence[str]) -> list[str]:
    """Return the notes on the commits that ran the rows."""
    remarks = []
    if len(known) > 1:
        remarks.append(
            f"Warning: these rows were run by {len(known)} versions of the code: "
            f"{', '.join(known)}. A new output=DIR runs all of them again."
        )
    elif known:
        remarks.append(f"Code: {known[0]}.")
    if any(commit.endswith("+") for commit in known):
        remarks.append("A commit with + had uncommitted changes.")
    return remarks


def law_text(record: Record) -> str:
    """Return the law of a row, or the cause of its failure, on one line."""
    if record["problem"] is not None:
        return str(record["problem"])
    if record["terms"] is None:
        return "no law sought"
    return "; ".join(map(_term, record["terms"])) or "nothing"


def finished_line(record: Record) -> str:
    """Return the message for a finished row."""
    if record["problem"] is not None:
        return f"failed with exit code {record['exit_code']}: {record['problem']}"
    parts = [record["verdict"] or "no verdict", law_text(record)]
    if record["exact_support"] is not None:
        error = _share(record["coefficient_error"])
        within = f" within {error}" if record["coefficient_error"] else ""
        parts.append(f"exact{within}" if record["exact_support"] else "not the true law")
    ratio = record["ratios"][REFIT]
    return "  ".join([*parts, *([f"RMSE × {_number(ratio)}"] if ratio is not None else [])])


def _line(record: Record) -> list[str]:
    head = [record["system"], record["twin"], f"{record['noise']:g}", _sensors(record)]
    head.append(str(record["seed"]))
    if record["problem"] is not None:
        blank = [""] * (len(ROWS) - len(head) - 2)
        return [*head, f"failed ({record['exit_code']})", law_text(record), *blank]
    exact = {True: "yes", False: "no", None: ""}[record["exact_support"]]
    return [
        *head,
        record["verdict"] or "",
        law_text(record),
        exact,
        _share(record["coefficient_error"]),
        _number(record["field_rmse"].get("dashred")),
        _number(record["field_rmse"].get("corrected")),
        *(_number(record["ratios"][name]) for name in RATIOS),
        _number(current_names(record["forecast"]).get("corrected")),
        _seconds(record["seconds"].get("in all")),
    ]


def _sensors(record: Record) -> str:
    """Return the numbers of fit sensors and of extra ones where they differ from the system's."""
    sensors, extra = record.get("sensors"), record.get("extra")
    if extra is None:
        return "" if sensors is None else str(sensors)
    return f"{'' if sensors is None else sensors} ({extra} extra)".strip()


def _term(term: dict[str, Any]) -> str:
    if term["equation"] is None:
        return f"{term['parameter']}: {_number(term['from'])} → {_number(term['to'])}"
    std = f" ± {term['std']:.1g}" if term["std"] is not None else ""
    where = " in a region" if term["region"] is not None else ""
    return f"{term['equation']}: {term['coefficient']:+.4g}{std} · {term['term']}{where}"


def _median_and_worst(spread: dict[str, float | None], text: Any) -> str:
    if spread["median"] is None:
        return ""
    return f"{text(spread['median'])} ({text(spread['worst'])})"


def _share(value: float | None) -> str:
    return "" if value is None else f"{100 * value:.2g} %"


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"


def _seconds(value: float | None) -> str:
    return "" if value is None else f"{value:.0f}"
