"""Runs in a separate process that are killed at a given stage."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from queue import SimpleQueue

from tests.conftest import CHECKOUT

WAIT_SECONDS = 300.0


def start(words: list[str]) -> subprocess.Popen[str]:
    """Start ``python -m dashred.train`` as a user would."""
    return subprocess.Popen(
        [sys.executable, "-u", "-m", "dashred.train", *words],
        cwd=CHECKOUT,
        env=os.environ | {"NO_COLOR": "1", "COLUMNS": "200"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def kill_when(
    process: subprocess.Popen[str], reached: Callable[[list[str]], bool]
) -> tuple[list[str], bool]:
    """Kill a run at a given stage; return its output, and whether any process is left."""
    lines: SimpleQueue[str] = SimpleQueue()
    assert process.stdout is not None
    stdout = process.stdout

    def listen() -> None:
        for line in stdout:
            lines.put(line)

    listener = threading.Thread(target=listen, daemon=True)
    listener.start()
    watch = threading.Timer(WAIT_SECONDS, process.kill)
    watch.start()
    printed: list[str] = []
    try:
        while process.poll() is None and not reached(printed):
            while not lines.empty():
                printed.append(lines.get())
            threading.Event().wait(0.001)
    finally:
        watch.cancel()
        process.send_signal(signal.SIGKILL)
        process.wait()
    # Child processes hold the pipe, too: it closes when the last of them has ended.
    listener.join(10.0)
    left = listener.is_alive()
    if not left:
        stdout.close()
    return printed, left
