"""What a command of hours needs: its folder to itself, an end by whatever signal, logs' ends."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from dashred.core.errors import InputError


@contextmanager
def alone_in(output: Path, what: str) -> Iterator[None]:
    """Keep a second command of the same kind out of a folder.

    Raises:
        InputError: one is running there.
    """
    try:
        with FileLock(output / f".{what}.lock", timeout=0):
            yield
    except Timeout:
        raise InputError(
            f"another {what} is running in this folder",
            where=str(output),
            hint="wait for it, or choose another: output=DIR",
        ) from None


@contextmanager
def signals_as_interrupt() -> Iterator[None]:
    """Let a plain ``kill`` end a command as Ctrl-C does, and this where a shell had it ignored."""
    before = {how: signal.getsignal(how) for how in (signal.SIGINT, signal.SIGTERM)}
    for how in before:
        signal.signal(how, signal.default_int_handler)
    try:
        yield
    finally:
        for how, handler in before.items():
            signal.signal(how, handler)


def last_line(log: Path) -> str:
    """Return the end of a log: what it died of, an error's hint left out."""
    lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    said = [line for line in lines if line.strip() and not line.startswith(" ")]
    return said[-1][:200] if said else ""
