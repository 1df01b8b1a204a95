"""Run many independent tasks, some of them at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")


def run_all(
    run: Callable[[Task], Result],
    tasks: Sequence[Task],
    count: int,
    finished: Callable[[Result], None],
    stop: Callable[[], None],
) -> None:
    """Run all tasks in threads, which wait for processes.

    Args:
        run: runs a task, in a thread.
        tasks: the tasks, in the order in which they start.
        count: number of tasks at once.
        finished: called in this thread with each result, as they come.
        stop: called after an exception, such as Ctrl-C, to end what the threads wait for.
    """
    with ThreadPoolExecutor(max(1, min(count, len(tasks)))) as pool:
        futures = [pool.submit(run, task) for task in tasks]
        try:
            for done in as_completed(futures):
                finished(done.result())
        except BaseException:
            # The pool waits for its threads.
            pool.shutdown(wait=False, cancel_futures=True)
            stop()
            raise
