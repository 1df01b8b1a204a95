"""Support for long commands: folder locks, signal handling and the last line of a log."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from dashred.core.errors import InputError


@contextmanager
def lock_folder(output: Path, what: str) -> Iterator[None]:
    """Lock a folder against a second command of the same kind.

    Raises:
        InputError: such a command is already running there.
    """
    try:
        with FileLock(output / f".{what}.lock", timeout=0):
            yield
    except Timeout:
        raise InputError(
            f"another {what} is running in this folder",
            where=str(output),
            hint="wait until it ends, or choose another folder: output=DIR",
        ) from None


@contextmanager
def signals_as_interrupt() -> Iterator[None]:
    """Handle SIGTERM and SIGINT like Ctrl-C, even if the shell had ignored them."""
    before = {how: signal.getsignal(how) for how in (signal.SIGINT, signal.SIGTERM)}
    for how in before:
        signal.signal(how, signal.default_int_handler)
    try:
        yield
    finally:
        for how, handler in before.items():
            signal.signal(how, handler)


def last_line(log: Path) -> str:
    """Return the last line of a log, skipping the indented hint of an error."""
    lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    messages = [line for line in lines if line.strip() and not line.startswith(" ")]
    return messages[-1][:200] if messages else ""
