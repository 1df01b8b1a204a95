"""Calls of functions on the workers of a Dask cluster, for the length of an analysis."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError
from contextlib import contextmanager
from threading import Event
from typing import TYPE_CHECKING, ParamSpec, TypeVar

from dashred.core.cluster.word import WHERE, Cluster
from dashred.core.errors import InputError
from dashred.core.threads import is_given_up

if TYPE_CHECKING:
    from distributed import Client

# How often a call is repeated after its worker died.
RETRIES = 2
# Seconds between looks at whether the result is still waited for.
GLANCE = 0.5
P = ParamSpec("P")
T = TypeVar("T")
_in_use: ClusterCalls | None = None


class CallLostError(Exception):
    """A call has no result: its workers died, or nobody waits for it any more."""


class ClusterCalls:
    """Calls on the workers of a cluster.

    Attributes:
        count: number of calls at once.
    """

    def __init__(self, client: Client, count: int) -> None:
        self.count, self._client = count, client
        self._stopped = Event()

    def stop(self) -> None:
        """Wait for no call any longer."""
        self._stopped.set()

    def call(self, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """Call a function on a worker and wait for its result.

        Raises:
            CallLostError: there is no result.
            InputError: the scheduler is lost.
            Exception: what the function raises.
        """
        from distributed import KilledWorker

        future = self._client.submit(function, *args, **kwargs, pure=False, retries=RETRIES)
        while True:
            try:
                return future.result(timeout=GLANCE)
            except TimeoutError:
                if is_given_up() or self._stopped.is_set():
                    future.cancel()
                    raise CallLostError("is not waited for") from None
            except KilledWorker as killed:
                raise CallLostError(f"ends its worker: {str(killed)[:200]}") from None
            except CancelledError:
                raise InputError(
                    "the scheduler is lost",
                    where=WHERE,
                    hint="start it, and run the analysis again",
                ) from None

    def call_on_all(self, function: Callable[[], T]) -> dict[str, T]:
        """Return what a function returns on each worker, by the address of the worker."""
        found: dict[str, T] = self._client.run(function)
        return found


def cluster_in_use() -> ClusterCalls | None:
    """Return the calls on the cluster of the analysis; None without one."""
    return _in_use


@contextmanager
def use_cluster(cluster: Cluster | None, environment: Mapping[str, str]) -> Iterator[None]:
    """Use a cluster for the length of a block.

    Args:
        cluster: None for no cluster.
        environment: variables of the workers that are started on this machine.

    Raises:
        InputError: as :func:`dashred.core.cluster.connection.connect`.
    """
    global _in_use
    if cluster is None:
        yield
        return
    from dashred.core.cluster.connection import connect, task_count

    with connect(cluster, environment) as client:
        _in_use = ClusterCalls(client, task_count(client, cluster))
        try:
            yield
        finally:
            _in_use = None
