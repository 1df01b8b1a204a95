"""Processes that are started before they are needed, and what they end with."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from dashred.core.errors import DONE, OUR_FAILURE

# MLflow, with the module by which it reaches an SQLite store.
STORE = "mlflow.store.tracking.sqlalchemy_store"
# The analysis of a recording: its entry point, and what it imports late.
ANALYSIS = ("dashred.pipeline.analyse", "dashred.pipeline.outputs.report", STORE)


class EndedError(Exception):
    """A process ended with an exit code that is not 0."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        # A process ended by a signal has a negative code, which no shell would show.
        self.code = code if code > 0 else OUR_FAILURE


@contextmanager
def prewarmed(entry: str, *modules: str) -> Iterator[subprocess.Popen[str]]:
    """Start a process that imports an entry point and more modules, then waits for its words.

    The process is ended with the block.
    """
    command = [sys.executable, "-m", "dashred.pipeline.run.prewarmed", entry, *modules]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.terminate()
        process.wait()


def tell(process: subprocess.Popen[str], words: list[str]) -> None:
    """Run the entry point of a process with the words of its command line."""
    assert process.stdin is not None
    # A process that has died is noticed by its exit code.
    with suppress(BrokenPipeError), process.stdin as stdin:
        stdin.write(json.dumps(words) + "\n")


def wait(process: subprocess.Popen[str]) -> None:
    """Wait for a process to end.

    Raises:
        EndedError: its exit code is not 0.
    """
    if (code := process.wait()) != DONE:
        raise EndedError(code)
