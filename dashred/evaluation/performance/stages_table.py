"""The table of the stages of whole analyses."""

from __future__ import annotations

from collections.abc import Sequence

from dashred.evaluation.benchmark.table import Grid
from dashred.evaluation.performance.digits import three_digits
from dashred.evaluation.performance.rows import Row

# The stage of `run.json` that is the whole run.
WHOLE = "in all"


def stages_table(rows: Sequence[Row]) -> Grid:
    """Return the seconds of each stage of the whole analyses, the longest first."""
    runs = {str(row["size"]): row["seconds"] for row in rows if row["part"] == "stages"}
    titles = {title for seconds in runs.values() for title in seconds if title != WHOLE}
    ordered = sorted(titles, key=lambda title: -max(run.get(title, 0.0) for run in runs.values()))
    lines = [[title, *(_share(run, title) for run in runs.values())] for title in ordered]
    lines.append([WHOLE, *(three_digits(run[WHOLE]) for run in runs.values())])
    return Grid("Stages", ["stage", *(f"{name}, s" for name in runs)], lines if runs else [])


def _share(run: dict[str, float], title: str) -> str:
    if title not in run:
        return ""
    return f"{three_digits(run[title])} ({100 * run[title] / run[WHOLE]:.0f} %)"
