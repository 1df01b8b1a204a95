"""Seconds of many cases with several workers, by processes of this machine or on a Dask cluster.

If the machine has a core for every worker, a case computes. Otherwise it waits for as long, which
shows what the distribution of the cases costs, but not what the cores share, as memory and caches.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

from dashred.core.cluster.calls import ClusterCalls, cluster_in_use, use_cluster
from dashred.core.cluster.word import Cluster
from dashred.evaluation.performance.measured.setting import Setting
from dashred.evaluation.side_by_side import run_all

CASES = 16
# The problem of one large analysis, with 216 columns, and the seconds of its trajectory and of each
# column, for workers that wait.
LARGE = Setting(points=128, terms=200)
TRAJECTORY, COLUMN = 0.15, 0.025
COMPUTES, WAITS = "computes", "waits"
PROGRAMS = {
    COMPUTES: "total = 0\nfor i in range(20_000_000): total += i",
    WAITS: "import time\ntime.sleep(1.0)",
}


def kind_of_case(workers: Sequence[int]) -> str:
    """Return whether a case computes or waits, for these numbers of workers."""
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return COMPUTES if max(workers) <= (allowed or 1) else WAITS


def by_jobs(workers: int, kind: str, cases: int = CASES) -> dict[str, Any]:
    """Return the seconds of all cases, each a process of this machine, several at once."""
    return {"kind": kind, "cases": cases, "seconds": _seconds(workers, cases, _run, kind)}


def by_cluster(workers: int, kind: str, cases: int = CASES) -> dict[str, Any]:
    """Return the seconds of all cases on a cluster of this machine, and those of its start.

    The start includes the import of the package by each worker, for which a first case would wait.
    """
    began = time.perf_counter()
    with use_cluster(Cluster("local", workers), {}):
        calls = cluster_in_use()
        assert calls is not None
        calls.call_on_all(_nothing)
        started = time.perf_counter() - began
        seconds = _seconds(workers, cases, _on(calls), kind)
    return {"kind": kind, "cases": cases, "seconds": seconds, "start": started}


def by_columns(workers: int, kind: str) -> dict[str, Any]:
    """Return the seconds of one large Jacobian on a cluster of this machine.

    Where a worker has no core of its own, columns wait as long as they take on a core at 2.8 GHz.
    """
    from dashred.core.threads import use_threads
    from dashred.evaluation.performance.measured.problem import UnitProblem
    from dashred.evaluation.performance.measured.setting import COLUMNS

    use_threads(1)
    problem = UnitProblem(LARGE)
    problem.warm_up()
    columns, compute = len(problem.phi), problem.pieces[COLUMNS]
    if kind == WAITS:
        problem.waits(TRAJECTORY, COLUMN)
    with use_cluster(Cluster("local", workers), {}):
        # The workers import the package, and are sent what they keep.
        compute()
        began = time.perf_counter()
        compute()
        return {"kind": kind, "cases": columns, "seconds": time.perf_counter() - began}


def _seconds(workers: int, cases: int, run: Callable[[str], None], kind: str) -> float:
    began = time.perf_counter()
    run_all(run, [kind] * cases, workers, lambda _: None, lambda: None)
    return time.perf_counter() - began


def _on(calls: ClusterCalls) -> Callable[[str], None]:
    def run(kind: str) -> None:
        calls.call(_run, kind)

    return run


def _nothing() -> None:
    """Do nothing; a worker has to import this module to be able to."""


def _run(kind: str) -> None:
    """Run a case in a process of its own, as analyses do."""
    subprocess.run([sys.executable, "-S", "-c", PROGRAMS[kind]], check=True)
