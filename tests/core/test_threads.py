"""Tasks in threads: whether anybody waits for one is known in its own threads alone."""

from __future__ import annotations

import time
from threading import Event

import pytest

from dashred.core.threads import in_threads, is_given_up


@pytest.mark.parametrize("nested", [False, True])
def test_a_task_that_is_given_up_knows_it(nested: bool) -> None:
    started, ended = Event(), Event()

    def wait(_: int) -> None:
        started.set()
        end = time.monotonic() + 20
        while not is_given_up() and time.monotonic() < end:
            time.sleep(0.01)
        ended.set()

    def run(i: int) -> None:
        if i == 0:
            started.wait()
        elif nested:
            for _ in in_threads(wait, 2, 2):
                pass
        else:
            wait(i)

    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        for _ in in_threads(run, 2, 2):
            raise KeyboardInterrupt
    assert ended.is_set() and time.monotonic() - began < 10
    # What begins later is not given up, whatever its number of threads.
    assert not is_given_up()
    seen: list[bool] = []
    for _ in in_threads(lambda _: seen.append(is_given_up()), 1):
        pass
    for _ in in_threads(lambda _: seen.append(is_given_up()), 2, 2):
        pass
    assert seen == [False] * 3
