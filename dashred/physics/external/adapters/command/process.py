"""One process with a time limit, of which nothing is left behind."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from dashred.core.budget import duration
from dashred.core.threads import is_given_up
from dashred.physics.external.adapters.command.left_behind import marked_environment
from dashred.physics.external.state_batch import ProgramError

# Seconds between looks at whether a process is still waited for.
GLANCE = 0.5
# Lines and characters of what a program said last.
LAST_LINES, LAST_CHARACTERS = 5, 600


def run_process(words: list[str], folder: Path, seconds: float) -> None:
    """Run a command in the folder ``work`` of a scratch folder, and wait for its end.

    Its output is in the files ``stdout`` and ``stderr``. Whatever it has started is ended with it.

    Args:
        words: program and arguments.
        folder: scratch folder.
        seconds: time limit.

    Raises:
        ProgramError: it cannot be started, fails, or runs too long.
    """
    work = folder / "work"
    work.mkdir()
    with (folder / "stdout").open("wb") as out, (folder / "stderr").open("wb") as err:
        try:
            process = subprocess.Popen(
                words,
                cwd=work,
                env=marked_environment(),
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                # A group of its own, so that it can be ended with all that it has started.
                start_new_session=True,
            )
        except OSError as error:
            raise ProgramError(f"cannot be started: {error.strerror}") from None
        try:
            code = _wait(process, seconds)
            cpu = _cpu_of_group(process.pid) if code is None else None
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    if code is None:
        hint = "raise system.simulator.time_limit if it needs longer, or if the machine is busy"
        used = f"{seconds:.3g} s" if cpu is None else duration(seconds, cpu)
        raise ProgramError(f"has not ended after {used}{_said(folder)}", hint)
    if code:
        how = f"exit code {code}" if code > 0 else f"signal {_signal_name(-code)}"
        raise ProgramError(f"fails with {how}{_said(folder)}")


def _wait(process: subprocess.Popen[bytes], seconds: float) -> int | None:
    """Return the exit code; None if the time is over, or nobody waits for the result."""
    end = time.monotonic() + seconds
    with _end_of(process) as wait:
        while (left := end - time.monotonic()) > 0 and not is_given_up():
            wait(min(left, GLANCE))
            if (code := process.poll()) is not None:
                return code
    return None


def _cpu_of_group(group: int) -> float | None:
    """Return the CPU seconds of the processes of a group, and of those that they have waited for.

    None where the system does not tell it.
    """
    ticks, known = 0, False
    for file in Path("/proc").glob("[0-9]*/stat"):
        # A process may have ended since.
        with suppress(OSError):
            # The name of the command, in parentheses, may contain blanks.
            values = file.read_text(errors="replace").rpartition(")")[2].split()
            if int(values[2]) == group:
                ticks, known = ticks + sum(map(int, values[11:15])), True
    return ticks / os.sysconf("SC_CLK_TCK") if known else None


@contextmanager
def _end_of(process: subprocess.Popen[bytes]) -> Iterator[Callable[[float], object]]:
    """Give a function that waits for the end of a process, or for some seconds.

    ``Popen.wait`` with a limit sleeps for as long again as the process has run, which a short
    process feels. Linux tells the end of a process at once.
    """

    def wait(seconds: float) -> None:
        with suppress(subprocess.TimeoutExpired):
            process.wait(seconds)

    try:
        file = os.pidfd_open(process.pid)
    except (AttributeError, OSError):  # not Linux, or too many open files
        yield wait
        return
    try:
        ended = select.poll()
        ended.register(file, select.POLLIN)
        yield lambda seconds: ended.poll(1000 * seconds)
    finally:
        os.close(file)


def last_lines(folder: Path) -> str:
    """Return the last lines of what a program wrote to stderr, or else to stdout."""
    for name in ("stderr", "stdout"):
        with (folder / name).open("rb") as file:
            file.seek(max(0, (folder / name).stat().st_size - 8 * LAST_CHARACTERS))
            text = file.read().decode(errors="replace")
        lines = [
            "".join(sign for sign in line if sign.isprintable())
            for line in text.splitlines()
            if line.strip()
        ]
        if lines:
            return "\n".join(lines[-LAST_LINES:])[-LAST_CHARACTERS:]
    return ""


def _said(folder: Path) -> str:
    lines = last_lines(folder).splitlines()
    return "".join(["; it said:", *(f"\n    {line}" for line in lines)]) if lines else ""


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return str(number)
