"""Start processes ahead of time, send them their arguments, and wait for them."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from dashred.core.errors import DONE, OUR_FAILURE

# The module with which MLflow accesses an SQLite store; importing it imports MLflow.
STORE = "mlflow.store.tracking.sqlalchemy_store"
# The analysis of a recording: its entry point and the modules that it imports late.
ANALYSIS = ("dashred.pipeline.analyse", "dashred.pipeline.outputs.report", STORE)


class ProcessFailedError(Exception):
    """A process ended with a nonzero exit code."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        # A process ended by a signal has a negative code, which is no valid exit code of ours.
        self.code = code if code > 0 else OUR_FAILURE


@contextmanager
def prewarmed(entry: str, *modules: str) -> Iterator[subprocess.Popen[str]]:
    """Start a process that imports an entry point and other modules, then waits for its arguments.

    The process is terminated at the end of the block.
    """
    command = [sys.executable, "-m", "dashred.pipeline.run.prewarmed", entry, *modules]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.terminate()
        process.wait()


def send_arguments(process: subprocess.Popen[str], words: list[str]) -> None:
    """Send a process the arguments of its entry point."""
    assert process.stdin is not None
    # A process that has died is detected by its exit code.
    with suppress(BrokenPipeError), process.stdin as stdin:
        stdin.write(json.dumps(words) + "\n")


def wait_for(process: subprocess.Popen[str]) -> None:
    """Wait for a process to end.

    Raises:
        ProcessFailedError: the exit code is not 0.
    """
    if (code := process.wait()) != DONE:
        raise ProcessFailedError(code)
