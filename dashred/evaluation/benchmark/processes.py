"""Run rows as processes, each with its own log, on this machine or on a Dask cluster."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from threading import Event, Lock

from dashred.core.cluster.calls import CallLostError, ClusterCalls, cluster_in_use
from dashred.core.errors import OUR_FAILURE
from dashred.evaluation.benchmark.plan import Row
from dashred.evaluation.side_by_side import run_all
from dashred.pipeline.run.output_dir import make_output

GRACE_SECONDS = 15.0
LOG = "log.txt"


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

    On a cluster, the folders of the rows and the store must have the same paths on all machines.

    Args:
        rows: rows in the order in which they start.
        jobs: number of parallel processes, without a cluster.
        command: returns the command of a row, which begins with the interpreter.
        log: name of the log file in the folder of a row.
        finished: called with the row, its exit code and its seconds.
    """
    calls = cluster_in_use()
    processes = _Processes() if calls is None else _ClusterProcesses(calls)

    def run(row: Row) -> tuple[Row, int, float]:
        began = time.perf_counter()
        make_output(str(row.folder))
        code = processes.run(command(row), row.folder / log)
        return row, code, time.perf_counter() - began

    count = jobs if calls is None else calls.count
    run_all(run, rows, count, lambda ended: finished(*ended), processes.stop)


class _ClusterProcesses:
    """Processes on the workers of a cluster."""

    def __init__(self, calls: ClusterCalls) -> None:
        self._calls, self.stop = calls, calls.stop

    def run(self, command: list[str], log: Path) -> int:
        """Run a process to its end and return its exit code."""
        try:
            return self._calls.call(run_logged, command, log)
        except CallLostError as lost:
            log.write_text(f"the process {lost}\n", encoding="utf-8")
            return OUR_FAILURE


def run_logged(command: list[str], log: Path) -> int:
    """Run a command with the interpreter of this worker, and return its exit code."""
    words = [sys.executable, *command[1:]]
    with log.open("wb") as file:
        return subprocess.run(
            words, stdin=subprocess.DEVNULL, stdout=file, stderr=subprocess.STDOUT, check=False
        ).returncode


class _Processes:
    """The running processes, each of which leads its own process group."""

    def __init__(self) -> None:
        self._lock, self._stopped = Lock(), Event()
        self._running: list[subprocess.Popen[bytes]] = []

    def run(self, command: list[str], log: Path) -> int:
        """Run a process to its end and return its exit code."""
        with log.open("wb") as file, self._lock:
            if self._stopped.is_set():
                return -signal.SIGINT
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                # In its own process group, so that Ctrl-C reaches it only through this process.
                start_new_session=True,
            )
            self._running.append(process)
        return process.wait()

    def stop(self) -> None:
        """Stop the running process groups by SIGINT, then SIGTERM, then SIGKILL."""
        with self._lock:
            self._stopped.set()
        running = [process for process in self._running if process.poll() is None]
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            for process in running:
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, number)
            deadline = time.perf_counter() + GRACE_SECONDS
            for process in running:
                with suppress(subprocess.TimeoutExpired):
                    process.wait(max(0.0, deadline - time.perf_counter()))
