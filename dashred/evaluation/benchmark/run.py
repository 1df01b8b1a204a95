"""A bench from its first row to its table, with its run in MLflow."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console

from dashred.core.errors import DONE, OUR_FAILURE, InputError
from dashred.core.files.atomic import write_text_atomic
from dashred.core.findings.findings import write_json_atomic
from dashred.core.job_control import lock_folder, signals_as_interrupt
from dashred.core.mlflow.store import find_run, open_store
from dashred.core.mlflow.tracker import Tracker
from dashred.core.progress import CONSOLE
from dashred.evaluation.benchmark import processes
from dashred.evaluation.benchmark.arguments import Request
from dashred.evaluation.benchmark.plan import Row
from dashred.evaluation.benchmark.processes import LOG, run_rows
from dashred.evaluation.benchmark.record import Record, read_done, write_record
from dashred.evaluation.benchmark.summary import as_metrics, commits, summarise
from dashred.evaluation.benchmark.table import (
    finished_line,
    notes,
    rows_grid,
    summary_grid,
    to_markdown,
    to_rich,
)
from dashred.pipeline.run.output_dir import make_output

# A log or a pipe has no width of its own, and tables are wide.
WIDE = 240


def run_bench(request: Request, rows: Sequence[Row]) -> int:
    """Run what is not done, write and print the tables; 1 when a row failed."""
    output = make_output(str(request.output))
    with lock_folder(output, "bench"), signals_as_interrupt():
        records = {row.folder: done for row in rows if (done := read_done(row))}
        waiting = [row for row in rows if row.folder not in records]
        CONSOLE.print(f"{len(rows)} rows, {len(records)} of them done already; in {output}")
        with parent_run(output, rows[0].store, rows) as run:
            nested = nested_below(run, rows[0].store)

            def command(row: Row) -> list[str]:
                return processes.train_command([*row.words, *nested, f"output={row.folder}"])

            def finished(row: Row, code: int, seconds: float) -> None:
                records[row.folder] = write_record(row, code, seconds)
                # The analysis could read its own run's name, so that names no twin while it runs.
                if "mlflow_run" in records[row.folder]:
                    run.rename(records[row.folder]["mlflow_run"], str(row))
                told = finished_line(records[row.folder])
                place = f"[{len(records)}/{len(rows)}]"
                text = f"{place} {row}  {told}  {seconds:.0f} s"
                CONSOLE.print(text, markup=False, soft_wrap=True)

            run_rows(waiting, request.jobs, command, LOG, finished)
            ended = [records[row.folder] for row in rows]
            _conclude(ended, output, run)
    return OUR_FAILURE if any(record["problem"] for record in ended) else DONE


def _conclude(records: Sequence[Record], output: Path, run: Tracker) -> None:
    """Write the tables, log them, and print them."""
    summaries = summarise(records)
    grids, said = [rows_grid(records), summary_grid(summaries)], notes(records)
    write_json_atomic(output / "table.json", {"rows": records, "summary": summaries})
    write_text_atomic(output / "table.md", to_markdown(grids, said))
    run.log_metrics(as_metrics(summaries), 0)
    run.set_tags({"git commit": ", ".join(commits(records))})
    for name in ("table.md", "table.json"):
        run.log_file(output / name)
    console = CONSOLE if CONSOLE.is_terminal else Console(width=WIDE, highlight=False)
    for grid in grids:
        console.print(to_rich(grid))
    for line in [*said, f"Tables: {output / 'table.md'}", f"MLflow store: {run.uri}"]:
        console.print(line, markup=False, soft_wrap=True)


def nested_below(run: Tracker, store: tuple[str, str]) -> list[str]:
    """Return the words that nest a row's own run below the bench's."""
    root, experiment = store
    return [
        f"tracking.root={root}",
        f"tracking.experiment={experiment}",
        f"tracking.parent={run.run_id}",
    ]


@contextmanager
def parent_run(output: Path, store: tuple[str, str], rows: Sequence[Row]) -> Iterator[Tracker]:
    """Open the run that the rows are nested below: one for each output folder, gone on with."""
    root, experiment = store
    file = output / "bench.json"
    earlier = _earlier_run(file, root, experiment)
    name = f"bench {', '.join(dict.fromkeys(row.name for row in rows))}"
    opened = (
        Tracker.reopen(root, experiment, earlier)
        if earlier
        else Tracker.open(root, experiment, name)
    )
    with opened as run:
        write_json_atomic(file, {"root": root, "experiment": experiment, "run": run.run_id})
        yield run


def _earlier_run(file: Path, root: str, experiment: str) -> str | None:
    try:
        known = json.loads(file.read_text(encoding="utf-8"))
        if (known["root"], known["experiment"]) != (root, experiment):
            return None
        return find_run(open_store(root, experiment), known["run"])
    except (OSError, ValueError, TypeError, KeyError, InputError):
        return None
