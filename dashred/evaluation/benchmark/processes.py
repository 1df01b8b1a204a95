"""Rows as processes: so many at once, each with its own log, none left behind."""

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
    """A row and its process, which leads a group of its own."""

    row: Row
    process: subprocess.Popen[bytes]
    began: float


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
    """Run every row; whatever ends this early ends the processes with it.

    Args:
        rows: in the order in which they start.
        jobs: how many run at once.
        command: of a row.
        log: name of the file in a row's folder that takes what its process prints.
        finished: takes the row, its exit code and its seconds.
    """
    waiting = deque(rows)
    running: list[Running] = []
    try:
        while waiting or running:
            while waiting and len(running) < jobs:
                row = waiting.popleft()
                running.append(_start(row, command(row), log))
            ended = [one for one in running if one.process.poll() is not None]
            for one in ended:
                running.remove(one)
                finished(one.row, one.process.returncode, time.perf_counter() - one.began)
            if not ended:
                time.sleep(POLL_SECONDS)
    finally:
        _end(running)


def _start(row: Row, command: list[str], log: str) -> Running:
    make_output(str(row.folder))
    with (row.folder / log).open("wb") as file:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            # Its own group: Ctrl-C reaches it, and the processes below it, through us alone.
            start_new_session=True,
        )
    return Running(row, process, time.perf_counter())


def _end(running: Sequence[Running]) -> None:
    """Interrupt what still runs, as Ctrl-C would; then insist, on what its leader has left too."""
    for how in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
        for one in running:
            with suppress(ProcessLookupError):
                os.killpg(one.process.pid, how)
        last = time.perf_counter() + GRACE_SECONDS
        for one in running:
            with suppress(subprocess.TimeoutExpired):
                one.process.wait(max(0.0, last - time.perf_counter()))
