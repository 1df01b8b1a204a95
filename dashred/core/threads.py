"""Parallel execution of independent compiled tasks in threads."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from threading import Event, local

import torch
from threadpoolctl import threadpool_limits

_threads = 1
# In each thread of a call of `in_threads`, what tells that its results are given up.
_own = local()


def use_threads(count: int) -> None:
    """Set the number of threads for the whole process."""
    global _threads
    _threads = count


def compute_in_one_thread() -> None:
    """Let torch and NumPy's linear algebra compute in one thread of this process."""
    torch.set_num_threads(1)
    threadpool_limits(1)


def thread_count() -> int:
    """Return the number of threads of the process."""
    return _threads


def is_given_up() -> bool:
    """Return whether nobody waits for the task of this thread; one that waits long should end."""
    return any(event.is_set() for event in getattr(_own, "given_up", ()))


def in_threads(
    run: Callable[[int], None], count: int, at_once: int | None = None
) -> Iterator[float]:
    """Run ``run(0), ..., run(count - 1)`` in threads; the tasks must be independent.

    The tasks must release the GIL to run in parallel.

    Args:
        run: runs a task.
        count: number of tasks.
        at_once: number of threads; by default that of the process.

    Yields:
        Fraction of finished tasks, after each task.
    """
    threads = _threads if at_once is None else at_once
    if count == 1 or threads == 1:
        for j in range(count):
            run(j)
            yield (j + 1) / count
        return
    given_up = Event()
    events = (*getattr(_own, "given_up", ()), given_up)

    def begin() -> None:
        # Each thread of torch would otherwise start several more.
        torch.set_num_threads(1)
        _own.given_up = events

    with ThreadPoolExecutor(threads, initializer=begin) as pool:
        try:
            for done, _ in enumerate(pool.map(run, range(count)), start=1):
                yield done / count
        except BaseException:  # Ctrl-C, for example
            given_up.set()
            raise
