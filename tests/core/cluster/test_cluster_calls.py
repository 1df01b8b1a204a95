"""Calls on a cluster: what they repeat, what they keep, and what they say when it is lost."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Timer

import pytest

from dashred.core.cluster import connection
from dashred.core.cluster.calls import ClusterCalls, NotAnsweredError, open_calls
from dashred.core.cluster.kept_objects import MOST, Missing, Package, Packages, call_with_kept
from dashred.core.cluster.word import Cluster
from tests.core.cluster.functions import die, fail, sum_of, wait

pytest.importorskip("distributed")

VALUES = [1.0, 2.0, 3.0]


@pytest.fixture(scope="module")
def calls() -> Iterator[ClusterCalls]:
    import dask

    # A worker is started again for every failure, which takes seconds.
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 1}),
        open_calls(Cluster("local", 2), {}) as opened,
    ):
        yield opened


def test_a_call_that_fails_is_not_repeated(calls: ClusterCalls, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="a wrong value"):
        calls.call(fail, tmp_path / "tried")
    assert (tmp_path / "tried").read_text() == "tried\n"


def test_a_stopped_call_is_not_waited_for(calls: ClusterCalls) -> None:
    own = ClusterCalls(calls._client, 1)
    began = time.monotonic()
    Timer(0.3, own.stop).start()
    with pytest.raises(NotAnsweredError, match="stopped"):
        own.call(wait, 5.0)
    assert time.monotonic() - began < 4


def test_a_worker_that_dies_gets_the_things_again(calls: ClusterCalls, tmp_path: Path) -> None:
    before = calls.call_with((VALUES,), sum_of, 2.0)
    after = calls.call_with((VALUES,), sum_of, 2.0, tmp_path / "marker")
    assert before[0] == after[0] == 12.0
    assert (tmp_path / "marker").exists()


def test_a_call_that_kills_its_workers_is_lost(calls: ClusterCalls) -> None:
    with pytest.raises(NotAnsweredError, match=r"cluster=: a part of the analysis ends its worker"):
        calls.call_with((VALUES,), die)


def test_a_worker_asks_for_what_it_lacks_and_keeps_what_was_used_last() -> None:
    packages = [Packages().of([float(i)]) for i in range(MOST + 1)]

    def ask(package: Package, *, sent: bool) -> object:
        contents = {package.name: package.content} if sent else {}
        found = call_with_kept((package.name,), contents, sum_of, (1.0,))
        return found if isinstance(found, Missing) else found[0]

    first, *others = packages
    assert ask(first, sent=False) == Missing((first.name,))
    assert [ask(package, sent=True) for package in packages[:MOST]] == [*map(float, range(MOST))]
    assert ask(first, sent=False) == 0.0
    assert ask(packages[MOST], sent=True) == float(MOST)
    assert ask(first, sent=False) == 0.0
    assert ask(others[0], sent=False) == Missing((others[0].name,))


def test_a_thing_is_named_by_its_content_and_packed_once() -> None:
    packages, equal = Packages(), list(VALUES)
    assert packages.of(VALUES).name == packages.of(equal).name != packages.of([0.0]).name
    assert packages.of(VALUES) is packages.of(VALUES)


@contextmanager
def scheduler() -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """Start a scheduler and a worker; return its address and process."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{probe.getsockname()[1]}"
    port = address.rpartition(":")[2]
    words = {
        "distributed.cli.dask_scheduler": ["--host", "127.0.0.1", "--port", port, "--no-dashboard"],
        "distributed.cli.dask_worker": [address, "--nthreads", "1", "--no-dashboard"],
    }
    null = subprocess.DEVNULL
    begun = [
        subprocess.Popen([sys.executable, "-m", module, *own], stdout=null, stderr=null)
        for module, own in words.items()
    ]
    try:
        yield address, begun[0]
    finally:
        for process in begun:
            process.kill()
            process.wait()


@pytest.mark.slow
def test_a_lost_scheduler_is_said_in_one_message(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "ANSWER_SECONDS", 120)
    with (
        scheduler() as (address, process),
        open_calls(Cluster("address", address=address), {}) as calls,
    ):
        assert calls.call(wait, 0.0) == 0.0
        Timer(1.0, process.kill).start()
        with pytest.raises(NotAnsweredError, match=r"cluster=: the scheduler is lost\n.*kept"):
            calls.call(wait, 60.0)
