"""Parent runs of commands and nested runs of their stages in MLflow."""

from __future__ import annotations

import getpass
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Self

from dashred.core.mlflow.run import METRIC_BATCH, MlflowRun, chunks
from dashred.core.mlflow.store import (
    Store,
    end_failed_run,
    find_run,
    mlflow_input_errors,
    open_store,
)
from dashred.core.mlflow.store_address import is_server
from dashred.core.mlflow.store_requests import Requests
from dashred.core.mlflow.unsent import add_unsent, read_unsent
from dashred.core.system_errors import ExternalServiceError


class _EndingRun(MlflowRun):
    """A run that this process ends."""

    @contextmanager
    def _until_its_end(self, *, as_finished: bool) -> Iterator[Self]:
        try:
            yield self
        except BaseException as error:
            self._end_after(error)
            raise
        self.send_metrics()
        if as_finished:
            self._finish()

    def _finish(self) -> None:
        self.send_metrics()
        self.request(lambda: self._store.client.set_terminated(self.run_id, "FINISHED"))

    def _end_after(self, error: BaseException) -> None:
        """Send the last metrics; an error of the store must not hide an earlier failure."""
        if self._requests.gave_up:
            return
        with suppress(ExternalServiceError):
            self._requests.attempt(self._send_waiting)
        end_failed_run(self._store, self.run_id, killed=isinstance(error, KeyboardInterrupt))


class ChildRun(_EndingRun):
    """A nested run: one stage of a command."""


class Tracker(_EndingRun):
    """The parent run of one command.

    Nested runs have the tag ``mlflow.parentRunId``; MLflow's pages show them below their parent.
    """

    @classmethod
    @contextmanager
    def open(
        cls,
        root: str,
        experiment: str,
        run_name: str,
        run_id: str | None = None,
        *,
        parent: str | None = None,
        artifacts: str | None = None,
    ) -> Iterator[Self]:
        """Open a new run, below ``parent`` if given, or attach to the existing run ``run_id``.

        A new run ends FINISHED, FAILED after an exception, or KILLED after Ctrl-C. An existing
        run is ended by the process that opened it, unless this one fails.

        Raises:
            InputError: the store cannot be used, or has no such run.
        """
        if run_id:
            # Another process has opened the store for this run, so it is waited for.
            opening = _requests(root, run_id)
            store = opening.send(lambda: open_store(root, experiment))
            opened = opening.send(lambda: find_run(store, run_id))
        else:
            store = open_store(root, experiment, artifacts)
            above = find_run(store, parent, key="tracking.parent") if parent else None
            tags = {"mlflow.parentRunId": above} if above else {}
            with mlflow_input_errors(store.uri):
                opened = _create_run(store, run_name, tags)
        requests = _requests(store.uri, opened)
        with cls(store, opened, requests)._until_its_end(as_finished=not run_id) as run:
            yield run

    @classmethod
    @contextmanager
    def reopen(cls, root: str, experiment: str, run_id: str) -> Iterator[Self]:
        """Resume a run that an earlier command has left, and end it here.

        Raises:
            InputError: the store cannot be used, or has no such run.
        """
        store = open_store(root, experiment)
        requests = _requests(store.uri, run_id)
        found = find_run(store, run_id)
        requests.send(lambda: store.client.update_run(found, "RUNNING"))
        with cls(store, run_id, requests)._until_its_end(as_finished=True) as run:
            yield run

    def rename(self, run_id: str, name: str) -> None:
        """Rename a run of the store; a deleted run is ignored."""
        with suppress(ExternalServiceError):
            self.request(lambda: self._store.client.update_run(run_id, name=name))

    def send_metrics(self) -> None:
        """Send the points that are waiting, and what an outage has left in a file."""
        super().send_metrics()
        path = self._store.unsent(self.run_id)
        if path.is_file():
            self.request(lambda: self._send_unsent(path))
            path.unlink()

    @contextmanager
    def child(self, name: str) -> Iterator[ChildRun]:
        """Open a nested run; it ends FINISHED, FAILED after an exception, or KILLED.

        Nested runs with the same name from an earlier attempt are deleted. At the end of a nested
        run, the metrics of this run are sent too: the checkpoint of the stage comes after it. If
        the store does not take them, they are kept in a file, so that the stage is not lost.
        """
        self.request(lambda: self._drop_children(name))
        above = {"mlflow.parentRunId": self.run_id}
        opened = self.request(lambda: _create_run(self._store, name, above))
        child = ChildRun(self._store, opened, self._requests)
        try:
            yield child
        except BaseException as error:
            child._end_after(error)
            raise
        try:
            child._finish()
            self.send_metrics()
        except ExternalServiceError:
            # The next request to the store ends the run, after the checkpoint of the stage.
            self._keep(child)

    def _drop_children(self, name: str) -> None:
        mine = f"tags.`mlflow.parentRunId` = '{self.run_id}'"
        for child in self._store.client.search_runs([self._store.experiment_id], mine):
            if child.info.run_name == name:
                self._store.client.delete_run(child.info.run_id)

    def _keep(self, child: ChildRun) -> None:
        points = {run.run_id: run._waiting for run in (child, self)}
        add_unsent(self._store.unsent(self.run_id), points, ended=child.run_id)
        child._waiting, self._waiting = [], []

    def _send_unsent(self, path: Path) -> None:
        client = self._store.client
        points, ended = read_unsent(path)
        for run_id, waiting in points.items():
            for part in chunks(waiting, METRIC_BATCH):
                client.log_batch(run_id, metrics=part)
        for run_id in ended:
            client.set_terminated(run_id, "FINISHED")


def _create_run(store: Store, name: str, tags: dict[str, str]) -> str:
    tags = {"mlflow.user": getpass.getuser(), "mlflow.source.name": "dashred", **tags}
    run = store.client.create_run(store.experiment_id, run_name=name, tags=tags)
    return str(run.info.run_id)


def _requests(uri: str, run_id: str) -> Requests:
    place = f" tracking.root={uri}" if is_server(uri) else ""
    hint = f"when the store is available again, continue with resume={run_id}{place}"
    return Requests(uri, hint)
