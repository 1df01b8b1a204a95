"""Measure the rows that are missing."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from dashred.core.errors import DONE
from dashred.core.files.atomic import clear_partial
from dashred.core.job_control import last_line, lock_folder, signals_as_interrupt
from dashred.core.progress import CONSOLE
from dashred.evaluation.benchmark.processes import LOG, run_logged, train_command
from dashred.evaluation.performance.arguments import Request
from dashred.evaluation.performance.page import check_page
from dashred.evaluation.performance.plan import GROWTHS, Task, tasks_of
from dashred.evaluation.performance.rows import Row, is_done, write_row
from dashred.evaluation.performance.speed_up import by_cluster, by_columns, by_jobs, kind_of_case
from dashred.pipeline.run.output_dir import make_output
from dashred.pipeline.run.provenance import git_commit

# What measures the parts in which workers are added.
SPEED_UPS = {"jobs": by_jobs, "cluster": by_cluster, "columns": by_columns}
CHILD = "dashred.evaluation.performance.measured.child"
# Variables that decide how many threads a process starts.
THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")


class MeasurementFailedError(Exception):
    """A row could not be measured."""


def measure_rows(request: Request) -> int:
    """Measure the missing rows of a request; return how many failed.

    Raises:
        InputError: the page has no place for the figures, or the folder cannot be used.
    """
    check_page(request.document)
    output = make_output(str(request.output))
    for name in ("rows", "logs"):
        (output / name).mkdir(exist_ok=True)
    clear_partial(output / "rows")
    tasks, failed = tasks_of(request), 0
    with lock_folder(output, "benchmark"), signals_as_interrupt():
        waiting = [task for task in tasks if not is_done(output, task)]
        _print(f"{len(tasks)} rows, {len(tasks) - len(waiting)} of them measured, in {output}")
        for number, task in enumerate(waiting, start=len(tasks) - len(waiting) + 1):
            began = time.perf_counter()
            try:
                found = _measured(request, task)
            except MeasurementFailedError as error:
                failed += 1
                result = f"failed: {error}"
            else:
                when = datetime.now(UTC).date().isoformat()
                write_row(output, task, {"git_commit": git_commit(), "date": when, **found})
                result = _told(found)
            took = time.perf_counter() - began
            _print(f"[{number}/{len(tasks)}] {task.part} {task.size}: {result}  ({took:.0f} s)")
    return failed


def _measured(request: Request, task: Task) -> Row:
    """Return what a row measures."""
    if task.part == "stages":
        return _stages(request.output, str(task.size))
    size = int(task.size)
    if task.part in SPEED_UPS:
        return SPEED_UPS[task.part](size, kind_of_case(request.workers))
    growth = GROWTHS[task.part]
    asked = {
        "setting": asdict(growth.setting(size)),
        "pieces": growth.pieces,
        "repeats": task.repeats,
        "floor": task.part == "grid",
    }
    log = request.output / "logs" / f"{task.name}.txt"
    return {"amount": growth.amount(size), **in_child(asked, log)}


def in_child(asked: dict[str, Any], log: Path) -> Row:
    """Measure in a process of its own, with one thread.

    Args:
        asked: the arguments of :func:`.measured.child.measure`.
        log: what the process prints besides its result.

    Raises:
        MeasurementFailedError: it has no result.
    """
    with log.open("wb") as file:
        ended = subprocess.run(
            [sys.executable, "-m", CHILD, json.dumps(asked)],
            env=os.environ | dict.fromkeys(THREADS, "1"),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=file,
            text=True,
            check=False,
        )
    if ended.returncode != DONE:
        reason = last_line(log) or "it was ended by the system, perhaps for its memory"
        raise MeasurementFailedError(f"exit code {ended.returncode}: {reason}")
    return dict(json.loads(ended.stdout.splitlines()[-1]))


def _stages(output: Path, system: str) -> Row:
    """Return the seconds of the stages and the work of a whole analysis of a twin."""
    folder = make_output(str(output / "analyses" / system))
    words = [f"conf={system}", "recording.twin=a", "threads=1", f"output={folder}"]
    words.append(f"tracking.root={output / 'mlruns'}")
    code = run_logged(train_command(words), folder / LOG)
    if code != DONE:
        raise MeasurementFailedError(last_line(folder / LOG) or f"exit code {code}")
    record = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    return {"seconds": record["seconds"], "work": record["work"]}


def _told(found: Row) -> str:
    if "pieces" in found:
        pieces = (f"{name} {piece['seconds']:.3g} s" for name, piece in found["pieces"].items())
        return f"{', '.join(pieces)}, {found['memory']:.0f} MiB"
    seconds = found["seconds"]
    return f"{seconds['in all'] if isinstance(seconds, dict) else seconds:.3g} s"


def _print(text: str) -> None:
    CONSOLE.print(text, markup=False, soft_wrap=True)
