"""Parallel execution of independent compiled tasks in threads."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import torch

_threads = 1


def use_threads(count: int) -> None:
    """Set the number of threads for the whole process."""
    global _threads
    _threads = count


def thread_count() -> int:
    """Return the number of threads of the process."""
    return _threads


def in_threads(run: Callable[[int], None], count: int) -> Iterator[float]:
    """Run ``run(0), ..., run(count - 1)`` in threads; the tasks must be independent.

    The tasks must release the GIL to run in parallel.

    Yields:
        Fraction of finished tasks, after each task.
    """
    if count == 1 or _threads == 1:
        for j in range(count):
            run(j)
            yield (j + 1) / count
        return
    # Each thread of torch would otherwise start several more.
    with ThreadPoolExecutor(_threads, initializer=torch.set_num_threads, initargs=(1,)) as pool:
        for done, _ in enumerate(pool.map(run, range(count)), start=1):
            yield done / count
