"""Parent runs of commands and nested runs of their stages in MLflow."""

import getpass
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Self, TypeVar

from dashred.core.mlflow.run import MlflowRun
from dashred.core.mlflow.store import (
    Store,
    end_failed_run,
    find_run,
    mlflow_input_errors,
    open_store,
)
from dashred.core.system_errors import ExternalServiceError

Logged = TypeVar("Logged", bound=MlflowRun)


class ChildRun(MlflowRun):
    """A nested run: one stage of a command."""


class Tracker(MlflowRun):
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
    ) -> Iterator[Self]:
        """Open a new run, below ``parent`` if given, or attach to the existing run ``run_id``.

        A new run ends FINISHED, FAILED after an exception, or KILLED after Ctrl-C. An existing
        run is ended by the process that opened it, unless this one fails.

        Raises:
            InputError: the store cannot be used, or has no such run.
        """
        store = open_store(root, experiment)
        if run_id:
            opened = find_run(store, run_id)
        else:
            above = find_run(store, parent, key="tracking.parent") if parent else None
            tags = {"mlflow.parentRunId": above} if above else {}
            with mlflow_input_errors(store.uri):
                opened = _create_run(store, run_name, tags)
        with _end_run(store, opened, as_finished=not run_id), _sending(cls(store, opened)) as run:
            yield run

    @classmethod
    @contextmanager
    def reopen(cls, root: str, experiment: str, run_id: str) -> Iterator[Self]:
        """Resume a run that an earlier command has left, and end it here.

        Raises:
            InputError: the store cannot be used, or has no such run.
        """
        store = open_store(root, experiment)
        store.client.update_run(find_run(store, run_id), "RUNNING")
        with _end_run(store, run_id, as_finished=True), _sending(cls(store, run_id)) as run:
            yield run

    def rename(self, run_id: str, name: str) -> None:
        """Rename a run of the store; a deleted run is ignored."""
        from mlflow.exceptions import MlflowException

        with suppress(MlflowException):
            self._store.client.update_run(run_id, name=name)

    @contextmanager
    def child(self, name: str) -> Iterator[ChildRun]:
        """Open a nested run; it ends FINISHED, FAILED after an exception, or KILLED.

        Nested runs with the same name from an earlier attempt are deleted. At the end of a nested
        run, the metrics of this run are sent too: the checkpoint of the stage comes after it.
        """
        self._drop_children(name)
        with self._service_errors():
            opened = _create_run(self._store, name, {"mlflow.parentRunId": self.run_id})
        with _end_run(self._store, opened, as_finished=True):
            with _sending(ChildRun(self._store, opened)) as child:
                yield child
            self.send_metrics()

    def _drop_children(self, name: str) -> None:
        mine = f"tags.`mlflow.parentRunId` = '{self.run_id}'"
        with self._service_errors():
            for child in self._store.client.search_runs([self._store.experiment_id], mine):
                if child.info.run_name == name:
                    self._store.client.delete_run(child.info.run_id)


def _create_run(store: Store, name: str, tags: dict[str, str]) -> str:
    tags = {"mlflow.user": getpass.getuser(), "mlflow.source.name": "dashred", **tags}
    run = store.client.create_run(store.experiment_id, run_name=name, tags=tags)
    return str(run.info.run_id)


@contextmanager
def _sending(run: Logged) -> Iterator[Logged]:
    """Send the last metrics at the end; an error of the store must not hide an earlier failure."""
    try:
        yield run
    except BaseException:
        with suppress(ExternalServiceError):
            run.send_metrics()
        raise
    run.send_metrics()


@contextmanager
def _end_run(store: Store, run_id: str, *, as_finished: bool) -> Iterator[None]:
    try:
        yield
    except BaseException as error:
        end_failed_run(store, run_id, killed=isinstance(error, KeyboardInterrupt))
        raise
    if as_finished:
        store.client.set_terminated(run_id, "FINISHED")
