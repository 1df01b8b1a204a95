"""Calls of functions on the workers of a Dask cluster, for the length of a command."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError
from contextlib import contextmanager
from threading import Event
from typing import TYPE_CHECKING, ParamSpec, TypeVar

from dashred.core.cluster.kept_objects import Missing, Packages, call_with_kept
from dashred.core.cluster.word import WHERE, Cluster
from dashred.core.errors import InputError
from dashred.core.threads import is_given_up

if TYPE_CHECKING:
    from distributed import Client

# Seconds between looks at whether a result is still waited for.
GLANCE = 0.5
P = ParamSpec("P")
T = TypeVar("T")
_in_use: ClusterCalls | None = None


class CallLostError(Exception):
    """A call has no result, because it ended every worker that it was tried on."""


class NotAnsweredError(InputError):
    """The command ends before a call has: nothing may be stored for it."""


class ClusterCalls:
    """Calls on the workers of a cluster.

    Dask repeats a call whose worker died on another worker, up to three times. A call that raises
    an exception is not repeated.

    Attributes:
        count: number of calls at once.
    """

    def __init__(self, client: Client, count: int) -> None:
        self.count, self._client = count, client
        self._stopped, self._packages = Event(), Packages()

    def stop(self) -> None:
        """Wait for no call any longer."""
        self._stopped.set()

    def call(self, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """Call a function on a worker and wait for its result.

        Raises:
            CallLostError: the call ended its workers.
            NotAnsweredError: the scheduler is lost, or the result is not waited for any more.
            Exception: what the function raises.
        """
        from distributed import KilledWorker

        future, done = self._client.submit(function, *args, **kwargs, pure=False), Event()
        # A result with a timeout would be interrupted while it is transferred, and then be lost.
        future.add_done_callback(lambda _: done.set())
        while not done.wait(GLANCE):
            if is_given_up() or self._stopped.is_set():
                future.cancel()
                raise NotAnsweredError("the calls on the cluster were stopped")
        try:
            return future.result()
        except KilledWorker as killed:
            raise CallLostError(f"ends its worker: {str(killed)[:200]}") from None
        except CancelledError:
            raise NotAnsweredError(
                "the scheduler is lost",
                where=WHERE,
                hint="what is finished is kept: start it, and run the command again",
            ) from None

    def call_with(self, things: tuple[object, ...], function: Callable[..., T], *args: object) -> T:
        """Call ``function(*things, *args)`` as :meth:`call` does; a worker keeps the things.

        Args:
            things: large objects that many calls share. Each is sent once to a worker. They are
                not changed as long as calls use them.
            function: what is called.
            args: further arguments, which travel with every call.

        Raises:
            NotAnsweredError: as for :meth:`call`, or the call ended its workers.
            Exception: what the function raises.
        """
        packages = [self._packages.of(thing) for thing in things]
        contents: dict[str, bytes] = {}
        while True:
            names = tuple(package.name for package in packages)
            try:
                found = self.call(call_with_kept, names, contents, function, args)
            except CallLostError as lost:
                raise NotAnsweredError(
                    f"a part of the analysis {lost}",
                    where=WHERE,
                    hint="what is finished is kept: give them more memory, or leave out cluster=",
                ) from None
            if not isinstance(found, Missing):
                return found
            contents |= {p.name: p.content for p in packages if p.name in found.names}

    def call_on_all(self, function: Callable[[], T]) -> dict[str, T]:
        """Return what a function returns on each worker, by the address of the worker."""
        found: dict[str, T] = self._client.run(function)
        return found


def cluster_in_use() -> ClusterCalls | None:
    """Return the calls on the cluster of the analysis; None without one."""
    return _in_use


@contextmanager
def open_calls(cluster: Cluster, environment: Mapping[str, str]) -> Iterator[ClusterCalls]:
    """Open a cluster for the length of a block.

    Args:
        cluster: what to start or to connect to.
        environment: variables of the workers that are started on this machine.

    Raises:
        InputError: as :func:`dashred.core.cluster.connection.connect`.
    """
    from dashred.core.cluster.connection import connect, task_count

    with connect(cluster, environment) as client:
        yield ClusterCalls(client, task_count(client, cluster))


@contextmanager
def use_cluster(cluster: Cluster | None, environment: Mapping[str, str]) -> Iterator[None]:
    """Use a cluster for the analysis of a block; arguments as for :func:`open_calls`.

    Args:
        cluster: None for no cluster.
        environment: variables of the workers that are started on this machine.

    Raises:
        InputError: as :func:`open_calls`.
    """
    global _in_use
    if cluster is None:
        yield
        return
    with open_calls(cluster, environment) as calls:
        _in_use = calls
        try:
            yield
        finally:
            _in_use = None
