"""Functions that the tests call on the workers of a cluster."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path


def fail(tried: Path) -> None:
    """Note the try, and raise an exception."""
    with tried.open("a") as file:
        file.write("tried\n")
    raise ValueError("a wrong value")


def sum_of(values: list[float], factor: float, marker: Path | None = None) -> tuple[float, int]:
    """Return a sum and the process; kill the first process that is given a marker."""
    if marker is not None and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return factor * sum(values), os.getpid()


def die(values: list[float]) -> None:
    """Kill the worker."""
    os.kill(os.getpid(), signal.SIGKILL)


def wait(seconds: float) -> float:
    """Wait."""
    time.sleep(seconds)
    return seconds
