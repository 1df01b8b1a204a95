"""A comparison from its first row to its page."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from dashred.benchmark.plan import Row
from dashred.benchmark.processes import run_rows
from dashred.benchmark.record import read_done
from dashred.benchmark.run import nested_below, parent_run, run_bench
from dashred.benchmark.words import Request
from dashred.comparison.document import write_results
from dashred.comparison.method_scores import Compared, read_compared, read_others
from dashred.comparison.ratios import ComparedRow, as_metrics
from dashred.errors import DONE, OUR_FAILURE
from dashred.long_run import alone_in, last_line, signals_as_interrupt
from dashred.output import make_output
from dashred.progress import CONSOLE
from dashred.tracking import Tracker

LOG = "other_methods.txt"


def run_comparison(request: Request, rows: Sequence[Row], document: Path) -> int:
    """Run what is not done and write the page; 1 when a row failed."""
    output = make_output(str(request.output))
    make_output(str(document.parent))
    code = run_bench(request, rows)
    analysed = {row.folder: record for row in rows if (record := read_done(row))}
    waiting = [row for row in rows if row.folder in analysed and read_compared(row.folder) is None]
    CONSOLE.print(f"other methods: {len(waiting)} of {len(analysed)} rows to do")
    with (
        alone_in(output, "comparison"),
        signals_as_interrupt(),
        parent_run(output, rows[0].store, rows) as run,
    ):
        nested = nested_below(run, rows[0].store)

        def command(row: Row) -> list[str]:
            own = [f"folder={row.folder}", f"noise={row.noise:.12g}"]
            module = "dashred.comparison.other_methods"
            return [sys.executable, "-m", module, *own, *row.words, *nested]

        run_rows(waiting, request.jobs, command, LOG, _finished)
        compared = [
            ComparedRow(analysed[row.folder], found, row.folder)
            for row in rows
            if row.folder in analysed and (found := read_compared(row.folder))
        ]
        write_results(compared, document)
        run.log_metrics(as_metrics(compared), 0)
        run.log_file(document)
        CONSOLE.print(f"Results: {document}", markup=False, soft_wrap=True)
    return OUR_FAILURE if code or len(compared) < len(rows) else DONE


def _finished(row: Row, code: int, seconds: float) -> None:
    found = read_compared(row.folder) if code == DONE else None
    if found is None:
        told = f"failed with exit code {code}: {last_line(row.folder / LOG)}"
    else:
        _log(found, row)
        told = ", ".join(f"{m} {c['rmse']:.3g}" for m, c in found.items() if c["rmse"] is not None)
    CONSOLE.print(f"{row}  {told}  {seconds:.0f} s", markup=False, soft_wrap=True)


def _log(found: dict[str, Compared], row: Row) -> None:
    """Log every method's scores to the row's nested run."""
    root, experiment = row.store
    scores = {
        f"{key}/{method}": float(value)
        for method, compared in found.items()
        for key, value in compared.items()
        if isinstance(value, int | float)
    }
    opened = read_others(row.folder)["mlflow_run"]
    with Tracker.open(root, experiment, "", opened) as run:
        run.log_metrics(scores, 0)
        run.rename(opened, f"{row}: other methods")
