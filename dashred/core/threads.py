"""Parallel execution of independent compiled tasks in threads."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from threading import Event, current_thread

import torch
from threadpoolctl import threadpool_limits

# Beginning of the names of the threads; what they do in threads ends with them.
NAME = "in_threads"
_threads = 1
_given_up = Event()


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
    """Return whether nobody waits for the tasks any more; a task that waits long should end."""
    return _given_up.is_set()


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
    if not current_thread().name.startswith(NAME):
        _given_up.clear()
    if count == 1 or threads == 1:
        for j in range(count):
            run(j)
            yield (j + 1) / count
        return
    # Each thread of torch would otherwise start several more.
    with ThreadPoolExecutor(threads, NAME, torch.set_num_threads, (1,)) as pool:
        try:
            for done, _ in enumerate(pool.map(run, range(count)), start=1):
                yield done / count
        except BaseException:  # Ctrl-C, for example
            _given_up.set()
            raise
