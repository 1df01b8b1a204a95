"""Start a Dask cluster or connect to one, and check its workers."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

from dashred.core.cluster.word import WHERE, Cluster
from dashred.core.cluster.workers import check_workers
from dashred.core.errors import InputError
from dashred.core.progress import CONSOLE

if TYPE_CHECKING:
    from distributed import Client
    from distributed.deploy.cluster import Cluster as StartedCluster

# Seconds in which a scheduler has to answer, and in which a worker of a batch system has to start.
ANSWER_SECONDS, START_SECONDS = 10, 600
# Size of the arguments of a call of which Dask warns.
MOST_SENT = "4 GiB"


@contextmanager
def connect(cluster: Cluster, environment: Mapping[str, str] | None = None) -> Iterator[Client]:
    """Connect to a cluster for the length of a block; a cluster that was started here is ended.

    Args:
        cluster: what to connect to.
        environment: variables of workers that are started on this machine, besides the inherited.

    Raises:
        InputError: Dask is not installed, nobody listens at the address, no worker starts, or a
            worker has another version of the package.
    """
    try:
        from distributed import Client
    except ImportError:
        raise _not_installed("distributed", "dashred[cluster]") from None
    _silence()
    if cluster.kind == "address":
        try:
            client = Client(cluster.address, timeout=ANSWER_SECONDS, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            hint = "start one with: dask scheduler"
            raise InputError(
                f"no scheduler answers at {cluster.address} ({_first_line(error)})",
                where=WHERE,
                hint=hint,
            ) from None
        with client:
            yield _checked(client, cluster)
    else:
        # As a default client, it would make xarray lock the files of the run on the scheduler.
        with (
            _start(cluster, environment or {}) as started,
            Client(started, set_as_default=False) as client,
        ):
            yield _checked(client, cluster)


def _silence() -> None:
    """Leave the reports of lost connections, with their tracebacks, to the errors of the tasks.

    Dask also warns of large arguments. Those of :mod:`.kept_objects` are sent once.
    """
    import dask

    dask.config.set({"distributed.admin.large-graph-warning-threshold": MOST_SENT})
    for name in logging.root.manager.loggerDict:
        if name.partition(".")[0] == "distributed":
            logging.getLogger(name).setLevel(logging.CRITICAL)


def _start(cluster: Cluster, environment: Mapping[str, str]) -> StartedCluster:
    """Start a cluster of this machine or of a batch system, as Dask's configuration says."""
    if cluster.kind == "local":
        from distributed import LocalCluster

        # One thread each: an analysis is a process of its own that uses one core.
        return LocalCluster(
            n_workers=cluster.workers or os.cpu_count(),
            threads_per_worker=1,
            dashboard_address=":0",
            silence_logs=logging.CRITICAL,
            env=dict(environment),
        )
    try:
        if cluster.kind == "slurm":
            from dask_jobqueue import SLURMCluster

            batch = SLURMCluster()
        else:
            from dask_kubernetes.operator import KubeCluster

            batch = KubeCluster(name="dashred")
    except ImportError:
        package = {"slurm": "dask-jobqueue", "kubernetes": "dask-kubernetes"}[cluster.kind]
        raise _not_installed(package, package) from None
    except Exception as error:
        hint = f"set it up in Dask's configuration, and try it alone: {type(error).__name__}"
        raise InputError(
            f"the {cluster.kind} cluster does not start: {_first_line(error)}",
            where=WHERE,
            hint=hint,
        ) from error
    batch.scale(cluster.workers)
    return batch


def _checked(client: Client, cluster: Cluster) -> Client:
    """Wait for the first worker, compare the workers with this process, and print the link."""
    seconds = ANSWER_SECONDS if cluster.kind == "address" else START_SECONDS
    try:
        client.wait_for_workers(1, timeout=seconds)
    except TimeoutError:
        raise InputError(
            f"the cluster has no worker after {seconds} s",
            where=WHERE,
            hint="start one with: dask worker ADDRESS",
        ) from None
    check_workers(client)
    text = f"{task_count(client, cluster)} tasks at once; dashboard: {client.dashboard_link}"
    CONSOLE.print(text, markup=False, soft_wrap=True)
    return client


def task_count(client: Client, cluster: Cluster) -> int:
    """Return the number of tasks at once; workers of a batch system may still have to start."""
    return max(cluster.workers or 1, sum(client.nthreads().values()))


def _not_installed(package: str, wanted: str) -> InputError:
    return InputError(f"{package} is not installed", where=WHERE, hint=f'pip install "{wanted}"')


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:200]
