"""Where the analyses of a command run: in processes of this machine, or on a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event
from typing import Protocol

from dashred.core.cluster.calls import CallLostError, ClusterCalls, NotAnsweredError, open_calls
from dashred.core.cluster.word import Cluster
from dashred.evaluation.isolation.analysis import Analysis, Answer, analyse
from dashred.evaluation.isolation.worker import Worker


class Analysts(Protocol):
    """A way to analyse recordings.

    Attributes:
        count: number of analyses at once.
    """

    count: int

    def analyse(self, analysis: Analysis) -> Answer:
        """Run an analysis and wait for its answer.

        Raises:
            NotAnsweredError: the analyses were stopped, or the scheduler of the cluster is lost.
        """

    def stop(self) -> None:
        """End the running analyses."""


class LocalAnalysts:
    """Analyse in processes of this machine; see :class:`Analysts`."""

    def __init__(self, jobs: int) -> None:
        self.count = jobs
        self._started: list[Worker] = []
        self._stopped = Event()

    def analyse(self, analysis: Analysis) -> Answer:
        """Run an analysis and wait for its answer."""
        answer = analyse(analysis, self._note)
        self._check()
        return answer

    def stop(self) -> None:
        """End the running analyses."""
        self._stopped.set()
        for worker in list(self._started):
            worker.process.kill()

    def _note(self, worker: Worker) -> None:
        self._started.append(worker)
        self._check()

    def _check(self) -> None:
        if self._stopped.is_set():
            raise NotAnsweredError("the analyses were stopped")


class ClusterAnalysts:
    """Analyse on the workers of a Dask cluster; see :class:`Analysts`."""

    def __init__(self, calls: ClusterCalls) -> None:
        self._calls, self.count, self.stop = calls, calls.count, calls.stop

    def analyse(self, analysis: Analysis) -> Answer:
        """Run an analysis and wait for its answer; if all its workers died, there is none."""
        try:
            return self._calls.call(analyse, analysis)
        except CallLostError as lost:
            return Answer(0.0, 0.0, f"the analysis {lost}", b"", lost=True)


@contextmanager
def open_analysts(cluster: Cluster | None, jobs: int) -> Iterator[Analysts]:
    """Open the analysts of a command.

    Args:
        cluster: cluster whose workers run the analyses; None runs them on this machine.
        jobs: number of analyses at once on this machine.

    Raises:
        InputError: as :func:`dashred.core.cluster.calls.open_calls`.
    """
    if cluster is None:
        yield LocalAnalysts(jobs)
        return
    with open_calls(cluster, {}) as calls:
        yield ClusterAnalysts(calls)
