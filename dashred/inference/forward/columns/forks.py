"""Independent tasks side by side in copies of this process.

Threads of Python wait for each other between short calls of compiled code; processes do not. A
forked process begins with the memory of this one, so nothing is sent to it or compiled again.
"""

from __future__ import annotations

import gc
import pickle
import signal
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing import current_process, get_context
from multiprocessing.connection import Connection
from typing import TypeVar

from dashred.core.threads import compute_in_one_thread, thread_count, use_threads

T = TypeVar("T")
# Seconds in which a process ends that is told to.
GRACE = 5.0


def can_fork() -> bool:
    """Return whether copies of this process can compute: on Linux, for one that may have them."""
    return sys.platform == "linux" and not current_process().daemon


def in_forks(tasks: Sequence[Callable[[], T]]) -> list[T]:
    """Return the results of tasks, the first of which runs in this process.

    A task without an answer is repeated in this process, where it raises its own exception.

    Args:
        tasks: they compute in one thread and change nothing. Their results are pickled.
    """
    others = [_Fork(task) for task in tasks[1:]]
    try:
        with _one_thread():
            results = [tasks[0]()]
            for fork, task in zip(others, tasks[1:], strict=True):
                answer = fork.answer()
                results.append(task() if answer is None else pickle.loads(answer))
        return results
    finally:
        for fork in others:
            fork.end()


class _Fork:
    """A copy of this process that runs one task."""

    def __init__(self, task: Callable[[], object]) -> None:
        context = get_context("fork")
        self._receiver, sender = context.Pipe(duplex=False)
        self._process = context.Process(target=_run, args=(task, sender), daemon=True)
        with warnings.catch_warnings():
            # Python 3.12 warns of other threads. None of them holds a lock that the tasks take.
            warnings.simplefilter("ignore", DeprecationWarning)
            self._process.start()
        sender.close()

    def answer(self) -> bytes | None:
        """Wait for the pickled result; None if the process ended without one."""
        try:
            return self._receiver.recv_bytes()
        except (EOFError, OSError):
            return None

    def end(self) -> None:
        self._receiver.close()
        self._process.terminate()
        self._process.join(GRACE)


def _run(task: Callable[[], object], sender: Connection) -> None:
    # Ctrl-C is for the process that waits, which ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    # What the other process has left behind is not to be closed here.
    gc.disable()
    use_threads(1)
    compute_in_one_thread()
    try:
        answer = pickle.dumps(task())
    except Exception:
        return  # no answer
    try:
        sender.send_bytes(answer)
    except OSError:
        return  # nobody waits for it


@contextmanager
def _one_thread() -> Iterator[None]:
    """Use one thread in this process, because the other cores are in use."""
    before = thread_count()
    use_threads(1)
    try:
        yield
    finally:
        use_threads(before)
