"""Connecting to clusters: what is wrong with one is said in one message."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import pytest

from dashred.core.cluster import connection, workers
from dashred.core.cluster.word import Cluster
from dashred.core.errors import InputError
from tests.core.cluster.functions import wait

pytest.importorskip("distributed")


def test_nobody_listens(monkeypatch) -> None:
    monkeypatch.setattr(connection, "ANSWER_SECONDS", 1)
    with (
        pytest.raises(InputError, match=r"no scheduler answers at tcp://127.0.0.1:9"),
        connection.connect(Cluster("address", address="tcp://127.0.0.1:9")),
    ):
        pass


@pytest.mark.parametrize(
    ("kind", "package"), [("slurm", "dask-jobqueue"), ("kubernetes", "dask-kubernetes")]
)
def test_a_package_that_is_missing_is_named(kind, package, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, package.replace("-", "_"), None)
    monkeypatch.setitem(sys.modules, "dask_kubernetes.operator", None)
    with (
        pytest.raises(InputError, match=f"{package} is not installed"),
        connection.connect(Cluster(kind, 2)),
    ):
        pass


class _Client:
    """A client of one worker, which answers as it is told."""

    def __init__(self, answer: dict[str, str] | str) -> None:
        self.answer = answer

    def run(self, function: Callable[[], Any]) -> dict[str, Any]:
        return {"tcp://10.0.0.2:4000": self.answer}


def test_a_worker_of_the_same_versions_is_accepted() -> None:
    workers.check_workers(_Client(workers.identity()))


def test_a_worker_without_the_package_is_refused() -> None:
    with pytest.raises(InputError, match="does not have the package: No module named 'dashred'"):
        workers.check_workers(_Client("No module named 'dashred'"))


def test_a_worker_of_other_versions_is_refused() -> None:
    other = workers.identity() | {"numpy": "1.0"}
    with pytest.raises(InputError, match=r"other versions: numpy 1\.0, here 2"):
        workers.check_workers(_Client(other))


def test_without_a_cluster_dask_is_not_imported() -> None:
    code = "import sys, dashred.evaluation.foreign.run, dashred.evaluation.proof.run\n"
    code += "print(sorted({'dask', 'distributed'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.slow
def test_a_cluster_that_is_closed_in_the_middle_of_a_task_says_nothing(capfd) -> None:
    with connection.connect(Cluster("local", 1)) as client:
        client.submit(wait, 30.0)
        time.sleep(2)
    assert capfd.readouterr().err == ""
