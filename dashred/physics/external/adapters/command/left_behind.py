"""Processes that the programs of this process have left behind.

A program is ended with its session. What it starts in another session, as a daemon is, outlives it.
It is known by a variable of the environment that it inherits, on systems with ``/proc``.
"""

from __future__ import annotations

import atexit
import os
import secrets
import signal
from contextlib import suppress
from functools import cache
from pathlib import Path

MARK = "DASHRED_STARTED_BY"
# The number of a process is given again after its end, and in each container.
_token = secrets.token_hex(8)


def marked_environment() -> dict[str, str]:
    """Return the environment of a program; what it leaves behind is ended with this process."""
    return {**os.environ, **marks()}


def marks() -> dict[str, str]:
    """Return the variable by which the programs of this process are known.

    A worker of a cluster that this process starts with it passes it on to its own programs.
    """
    _end_at_exit()
    return {MARK: " ".join([*os.environ.get(MARK, "").split(), _own_mark()])}


def end_left_behind() -> None:
    """End all processes that have the environment of this process' programs."""
    name, mark = f"{MARK}=".encode(), _own_mark().encode()
    for file in Path("/proc").glob("[0-9]*/environ"):
        # A process may have ended since, or belong to another user.
        with suppress(OSError):
            variables = file.read_bytes().split(b"\0")
            if any(v.startswith(name) and mark in v[len(name) :].split() for v in variables):
                os.kill(int(file.parent.name), signal.SIGKILL)


def _own_mark() -> str:
    """Return the mark of this process; one that it has forked has another."""
    return f"{os.getpid()}-{_token}"


@cache
def _end_at_exit() -> None:
    atexit.register(end_left_behind)
