"""Where the analyses of a command run: in processes of this machine, or on a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from threading import Event
from typing import TYPE_CHECKING, Protocol

from dashred.core.cluster.word import WHERE, Cluster
from dashred.core.errors import InputError
from dashred.evaluation.isolation.analysis import Analysis, Answer, analyse
from dashred.evaluation.isolation.worker import Worker

if TYPE_CHECKING:
    from distributed import Client

# How often an analysis is started again after its worker died.
RETRIES = 2


class NotAnsweredError(InputError):
    """The command ends before an analysis has: nothing may be stored for its case."""


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

    def __init__(self, client: Client, count: int) -> None:
        self.count = count
        self._executor = client.get_executor(pure=False, retries=RETRIES)

    def analyse(self, analysis: Analysis) -> Answer:
        """Run an analysis and wait for its answer; if all its workers died, there is none."""
        from distributed import KilledWorker

        try:
            return self._executor.submit(analyse, analysis).result()
        except KilledWorker as killed:
            return Answer(0.0, 0.0, f"its workers died: {str(killed)[:200]}", b"", lost=True)
        except CancelledError:
            raise NotAnsweredError(
                "the scheduler is lost",
                where=WHERE,
                hint="finished cases are kept: start the scheduler, and run the command again",
            ) from None

    def stop(self) -> None:
        """End the running analyses."""
        self._executor.shutdown(wait=False, cancel_futures=True)


@contextmanager
def open_analysts(cluster: Cluster | None, jobs: int) -> Iterator[Analysts]:
    """Open the analysts of a command.

    Args:
        cluster: cluster whose workers run the analyses; None runs them on this machine.
        jobs: number of analyses at once on this machine.

    Raises:
        InputError: as :func:`dashred.core.cluster.connection.connect`.
    """
    if cluster is None:
        yield LocalAnalysts(jobs)
        return
    from dashred.core.cluster.connection import connect, task_count

    with connect(cluster) as client:
        yield ClusterAnalysts(client, task_count(client, cluster))
