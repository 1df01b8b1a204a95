"""Cases with several workers."""

from __future__ import annotations

import os

import pytest

from dashred.evaluation.performance import speed_up
from dashred.evaluation.performance.measured.setting import Setting
from dashred.evaluation.performance.speed_up import (
    COMPUTES,
    PROGRAMS,
    WAITS,
    by_cluster,
    by_columns,
    by_jobs,
    kind_of_case,
)

SHORT = "import time\ntime.sleep(0.4)"


def test_cases_wait_if_there_are_fewer_cores_than_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0, 1, 2, 3})
    assert kind_of_case([1, 4]) == COMPUTES
    assert kind_of_case([1, 8]) == WAITS


def test_waiting_cases_share_the_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PROGRAMS, WAITS, SHORT)
    one, four = (by_jobs(workers, WAITS, cases=4)["seconds"] for workers in (1, 4))
    # Four waits of 0.4 s after each other, and at once.
    assert one >= 1.6 and 0.4 <= four < 0.75 * one


def test_cases_run_on_a_cluster(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    found = by_cluster(2, WAITS, cases=2)
    # The workers are processes of their own: their cases wait for a second.
    assert found["seconds"] >= 1.0 and found["start"] > 0


def test_the_columns_of_one_jacobian_are_divided(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(speed_up, "LARGE", Setting(points=128, terms=120))
    monkeypatch.setattr(speed_up, "TRAJECTORY", 0.1)
    monkeypatch.setattr(speed_up, "COLUMN", 0.02)
    found = by_columns(2, WAITS)
    # All columns take 2.82 s one after the other, and two workers 1.46 s each.
    assert found["cases"] == 136 and 1.4 < found["seconds"] < 2.6
