"""Run independent pieces of compiled work side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import torch

_threads = 1


def use_threads(count: int) -> None:
    """Set how many pieces run at a time, in the whole process."""
    global _threads
    _threads = count


def in_threads(run: Callable[[int], None], count: int) -> Iterator[float]:
    """Run ``count`` independent pieces, which must hold no lock, several at a time.

    Yields:
        The share that is done, after each piece.
    """
    if count == 1 or _threads == 1:
        for j in range(count):
            run(j)
            yield (j + 1) / count
        return
    # In a thread of its own torch would take several more.
    with ThreadPoolExecutor(_threads, initializer=torch.set_num_threads, initargs=(1,)) as pool:
        for done, _ in enumerate(pool.map(run, range(count)), start=1):
            yield done / count
