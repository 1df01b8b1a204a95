"""Run a comparison: rows, other methods, and the document."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from dashred.core.cluster.calls import use_cluster
from dashred.core.errors import DONE, OUR_FAILURE
from dashred.core.job_control import last_line, lock_folder, signals_as_interrupt
from dashred.core.mlflow.tracker import Tracker
from dashred.core.progress import CONSOLE
from dashred.evaluation.benchmark.arguments import Request
from dashred.evaluation.benchmark.plan import Row
from dashred.evaluation.benchmark.processes import run_rows
from dashred.evaluation.benchmark.record import read_finished, read_record
from dashred.evaluation.benchmark.run import nested_arguments, parent_run, run_bench
from dashred.evaluation.comparison.comparison_file import (
    UNRESOLVED,
    MethodScore,
    read_comparison,
    write_failed_comparison,
)
from dashred.evaluation.comparison.document import write_results
from dashred.evaluation.comparison.method_scores import read_others
from dashred.evaluation.comparison.ratios import ComparedRow, as_metrics
from dashred.evaluation.comparison.stored_rows import rows_of_document
from dashred.physics.external.adapters.command.left_behind import marks
from dashred.pipeline.run.output_dir import make_output

LOG = "other_methods.txt"


def run_comparison(request: Request, rows: Sequence[Row], document: Path) -> int:
    """Run the unfinished rows and write the document of all rows; return 1 if a row failed."""
    output = make_output(str(request.output))
    make_output(str(document.parent))
    code = run_bench(request, rows)
    analysed = [row for row in rows if read_finished(row)]
    waiting = [row for row in analysed if not _is_final(row)]
    CONSOLE.print(f"other methods: {len(waiting)} of {len(analysed)} rows to do")
    with (
        lock_folder(output, "comparison"),
        signals_as_interrupt(),
        use_cluster(request.cluster, marks()),
        parent_run(output, rows[0].store, rows) as run,
    ):
        nested = nested_arguments(run, rows[0].store)

        def command(row: Row) -> list[str]:
            own = [f"folder={row.folder}", f"noise={row.noise:.12g}"]
            module = "dashred.evaluation.comparison.other_methods"
            return [sys.executable, "-m", module, *own, *row.words, *nested]

        run_rows(waiting, request.jobs, command, LOG, _finished)
        compared = list(map(compared_row, rows_of_document(request, rows)))
        write_results(compared, document)
        run.log_metrics(as_metrics(compared), 0)
        run.log_file(document)
        CONSOLE.print(f"Results: {document}", markup=False, soft_wrap=True)
    asked = {row.folder for row in rows}
    failed = any(row.problem for row in compared if row.folder in asked)
    return OUR_FAILURE if code or failed else DONE


def compared_row(row: Row) -> ComparedRow:
    """Return a row with its scores, or with the cause of its failure."""
    record = read_record(row)
    if record is None:
        raise RuntimeError(f"{row} was run but has no record")
    found = read_comparison(row.folder) if record["problem"] is None else None
    if found is None:
        return ComparedRow(record, {}, row.folder, record["problem"] or "not compared")
    return ComparedRow(
        record,
        found["methods"],
        row.folder,
        found["problem"],
        found["listed"],
        found["git_commit"],
    )


def _is_final(row: Row) -> bool:
    """Return whether a row is compared and another attempt would give the same result."""
    found = read_comparison(row.folder)
    return found is not None and found["problem"] in (None, UNRESOLVED)


def _finished(row: Row, code: int, seconds: float) -> None:
    found = read_comparison(row.folder)
    if found is None:
        cause = last_line(row.folder / LOG) or f"exit code {code}"
        found = write_failed_comparison(row.folder, f"not compared: {cause}")
    methods = found["methods"]
    _log(methods, row)
    lost = [f"{m} failed: {c['failed']}" for m, c in methods.items() if c["failed"]]
    known = [f"{m} {c['rmse']:.3g}" for m, c in methods.items() if c["rmse"] is not None]
    text = found["problem"] or ", ".join([*known, *lost])
    CONSOLE.print(f"{row}  {text}  {seconds:.0f} s", markup=False, soft_wrap=True)


def _log(found: dict[str, MethodScore], row: Row) -> None:
    """Log the scores of all methods to the nested run of the row."""
    scores = {
        f"{key}/{method}": float(value)
        for method, compared in found.items()
        for key, value in compared.items()
        if isinstance(value, int | float)
    }
    others = read_others(row.folder)
    if others is None:
        return
    opened = others["mlflow_run"]
    with Tracker.open(row.store.root, row.store.experiment, "", opened) as run:
        run.log_metrics(scores, 0)
        run.rename(opened, f"{row}: other methods")
