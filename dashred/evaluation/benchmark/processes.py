"""Run rows as parallel processes, each with its own log."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

from dashred.evaluation.benchmark.plan import Row
from dashred.pipeline.run.output_dir import make_output

POLL_SECONDS = 0.1
GRACE_SECONDS = 15.0
LOG = "log.txt"


@dataclass(frozen=True)
class Running:
    """A row and its process, which leads its own process group."""

    row: Row
    process: subprocess.Popen[bytes]
    started: float


def train_command(words: Sequence[str]) -> list[str]:
    """Return the command that analyses a twin."""
    return [sys.executable, "-m", "dashred.train", *words]


def run_rows(
    rows: Sequence[Row],
    jobs: int,
    command: Callable[[Row], list[str]],
    log: str,
    finished: Callable[[Row, int, float], None],
) -> None:
    """Run all rows; on an exception, stop their processes.

    Args:
        rows: rows in the order in which they start.
        jobs: number of parallel processes.
        command: returns the command of a row.
        log: name of the log file in the folder of a row.
        finished: called with the row, its exit code and its seconds.
    """
    waiting = deque(rows)
    running: list[Running] = []
    try:
        while waiting or running:
            while waiting and len(running) < jobs:
                row = waiting.popleft()
                running.append(_start(row, command(row), log))
            ended = [task for task in running if task.process.poll() is not None]
            for task in ended:
                running.remove(task)
                finished(task.row, task.process.returncode, time.perf_counter() - task.started)
            if not ended:
                time.sleep(POLL_SECONDS)
    finally:
        _stop(running)


def _start(row: Row, command: list[str], log: str) -> Running:
    make_output(str(row.folder))
    with (row.folder / log).open("wb") as file:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            # In its own process group, so that Ctrl-C reaches it only through this process.
            start_new_session=True,
        )
    return Running(row, process, time.perf_counter())


def _stop(running: Sequence[Running]) -> None:
    """Stop the running process groups by SIGINT, then SIGTERM, then SIGKILL."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
        for task in running:
            with suppress(ProcessLookupError):
                os.killpg(task.process.pid, number)
        deadline = time.perf_counter() + GRACE_SECONDS
        for task in running:
            with suppress(subprocess.TimeoutExpired):
                task.process.wait(max(0.0, deadline - time.perf_counter()))
