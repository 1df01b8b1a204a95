"""Run a benchmark: rows, tables, and its MLflow run."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console

from dashred.core.cluster.calls import use_cluster
from dashred.core.errors import DONE, OUR_FAILURE, InputError
from dashred.core.files.atomic import write_text_atomic
from dashred.core.findings.findings import write_json_atomic
from dashred.core.job_control import lock_folder, signals_as_interrupt
from dashred.core.mlflow.store import find_run, open_store
from dashred.core.mlflow.store_address import StorePlace
from dashred.core.mlflow.tracker import Tracker
from dashred.core.progress import CONSOLE
from dashred.evaluation.benchmark import processes
from dashred.evaluation.benchmark.arguments import Request
from dashred.evaluation.benchmark.plan import Row
from dashred.evaluation.benchmark.processes import LOG, run_rows
from dashred.evaluation.benchmark.record import Record, read_finished, write_record
from dashred.evaluation.benchmark.summary import as_metrics, commits, summarise
from dashred.evaluation.benchmark.table import (
    finished_line,
    notes,
    rows_grid,
    summary_grid,
    to_markdown,
    to_rich,
)
from dashred.physics.external.adapters.command.left_behind import marks
from dashred.pipeline.run.output_dir import make_output

# Width of tables where the output is not a terminal.
TABLE_WIDTH = 240


def run_bench(request: Request, rows: Sequence[Row]) -> int:
    """Run the unfinished rows, write and print the tables; return 1 if a row failed."""
    output = make_output(str(request.output))
    with (
        lock_folder(output, "bench"),
        signals_as_interrupt(),
        use_cluster(request.cluster, marks()),
    ):
        records = {row.folder: done for row in rows if (done := read_finished(row))}
        waiting = [row for row in rows if row.folder not in records]
        CONSOLE.print(f"{len(rows)} rows, {len(records)} of them already finished, in {output}")
        with parent_run(output, rows[0].store, rows) as run:
            nested = nested_arguments(run, rows[0].store)

            def command(row: Row) -> list[str]:
                return processes.train_command([*row.words, *nested, f"output={row.folder}"])

            def finished(row: Row, code: int, seconds: float) -> None:
                records[row.folder] = write_record(row, code, seconds)
                # Named after the analysis, which could otherwise read the name of the twin.
                if "mlflow_run" in records[row.folder]:
                    run.rename(records[row.folder]["mlflow_run"], str(row))
                result = finished_line(records[row.folder])
                place = f"[{len(records)}/{len(rows)}]"
                text = f"{place} {row}  {result}  {seconds:.0f} s"
                CONSOLE.print(text, markup=False, soft_wrap=True)

            run_rows(waiting, request.jobs, command, LOG, finished)
            ended = [records[row.folder] for row in rows]
            _write_tables(ended, output, run)
    return OUR_FAILURE if any(record["problem"] for record in ended) else DONE


def _write_tables(records: Sequence[Record], output: Path, run: Tracker) -> None:
    """Write, log and print the tables."""
    summaries = summarise(records)
    grids, remarks = [rows_grid(records), summary_grid(summaries)], notes(records)
    write_json_atomic(output / "table.json", {"rows": records, "summary": summaries})
    write_text_atomic(output / "table.md", to_markdown(grids, remarks))
    run.log_metrics(as_metrics(summaries), 0)
    run.set_tags({"git commit": ", ".join(commits(records))})
    for name in ("table.md", "table.json"):
        run.log_file(output / name)
    console = CONSOLE if CONSOLE.is_terminal else Console(width=TABLE_WIDTH, highlight=False)
    for grid in grids:
        console.print(to_rich(grid))
    for line in [*remarks, f"Tables: {output / 'table.md'}", f"MLflow store: {run.uri}"]:
        console.print(line, markup=False, soft_wrap=True)


def nested_arguments(run: Tracker, store: StorePlace) -> list[str]:
    """Return the arguments that nest the run of a row below that of the benchmark."""
    return [
        f"tracking.root={store.root}",
        f"tracking.experiment={store.experiment}",
        f"tracking.parent={run.run_id}",
    ]


@contextmanager
def parent_run(output: Path, store: StorePlace, rows: Sequence[Row]) -> Iterator[Tracker]:
    """Open or reopen the parent run of the rows, one per output folder."""
    root, experiment, artifacts = store
    file = output / "bench.json"
    earlier = _earlier_run(file, root, experiment)
    name = f"bench {', '.join(dict.fromkeys(row.name for row in rows))}"
    opened = (
        Tracker.reopen(root, experiment, earlier)
        if earlier
        else Tracker.open(root, experiment, name, artifacts=artifacts)
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
