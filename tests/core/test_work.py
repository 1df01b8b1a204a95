"""Counts of the work of a process."""

from __future__ import annotations

from threading import Thread

from dashred.core.work import count_columns, count_trajectories, count_transforms, work_done


def test_counts_add_up() -> None:
    before = work_done()
    count_trajectories(rows=3, steps=5, values=7)
    count_columns(columns=2, steps=5, values=7)
    count_transforms(count=4, points=64)
    added = {kind: count - before.get(kind, 0) for kind, count in work_done().items()}
    assert added == {
        "trajectory steps": 15,
        "trajectory values": 105,
        "column steps": 10,
        "column values": 70,
        "transforms": 4,
        "transform values": 256,
    }


def test_threads_lose_no_count() -> None:
    before = work_done()

    def count() -> None:
        for _ in range(2000):
            count_transforms(1, 1)

    threads = [Thread(target=count) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert work_done()["transforms"] - before.get("transforms", 0) == 16_000
