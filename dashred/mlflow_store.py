"""The MLflow store on disk: `ROOT/mlflow.db` with its artifacts under `ROOT/artifacts`.

Several processes may open a fresh store at the same moment. MLflow creates the tables without a
lock of its own, so the opening stands under a file lock.
"""

import logging
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from filelock import FileLock, Timeout

from dashred.errors import InputError

if TYPE_CHECKING:
    from mlflow import MlflowClient

# MLflow reads these when it is imported, so here is the last moment to say no.
os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
os.environ.setdefault("DO_NOT_TRACK", "true")

LOCK_SECONDS = 120


@dataclass(frozen=True)
class Store:
    """An open store and the experiment in it: `artifacts` is an absolute local folder."""

    client: "MlflowClient"
    uri: str
    artifacts: Path
    experiment_id: str

    def artifact_dir(self, run_id: str) -> Path:
        """The folder of a run's artifacts, where MLflow looks for them; created if new."""
        folder = self.artifacts / run_id / "artifacts"
        folder.mkdir(parents=True, exist_ok=True)
        return folder


def open_store(root: str, experiment: str) -> Store:
    """Open the store, creating folder, tables and experiment where they are missing.

    Raises:
        InputError: if the folder or the database cannot be used, or the experiment was deleted.
    """
    from mlflow import MlflowClient
    from mlflow.exceptions import MlflowException

    folder = _folder(root)
    uri, artifacts = f"sqlite:///{folder / 'mlflow.db'}", folder / "artifacts"
    with _locked(folder), _quiet():
        try:
            client = MlflowClient(tracking_uri=uri)
            experiment_id = _experiment_id(client, experiment, artifacts)
        except MlflowException as error:
            raise InputError(
                f"MLflow cannot use this store: {str(error).splitlines()[0]}",
                where=str(folder / "mlflow.db"),
                hint="choose another folder with tracking.root=DIR",
            ) from error
    return Store(client, uri, artifacts, experiment_id)


def find_run(store: Store, run_id: str, *, key: str = "tracking.run") -> str:
    """The id itself, once it is sure that the store has this run; `key` is where it was given.

    Raises:
        InputError: if there is no such run, or it was deleted.
    """
    from mlflow.exceptions import MlflowException

    try:
        found = store.client.get_run(run_id).info.lifecycle_stage == "active"
    except MlflowException:
        found = False
    if not found:
        hint = f"leave {key} out to open a new run"
        raise InputError(f"there is no run {run_id!r} in {store.uri}", where=key, hint=hint)
    return run_id


def end_failed_run(store: Store, run_id: str, *, killed: bool) -> None:
    """Mark a run FAILED or KILLED; a store that refuses must not hide the failure itself."""
    from mlflow.exceptions import MlflowException

    with suppress(MlflowException):
        store.client.set_terminated(run_id, "KILLED" if killed else "FAILED")


def _folder(root: str) -> Path:
    folder = Path(root).expanduser().resolve()
    hint = "choose another folder with tracking.root=DIR"
    # MLflow takes the path for a URI: it would cut it at the one and decode the other.
    if {"?", "%"} & set(str(folder)):
        raise InputError("MLflow cannot use a path with ? or %", where=str(folder), hint=hint)
    try:
        (folder / "artifacts").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        what = f"no MLflow store can be made here: {error.strerror}"
        raise InputError(what, where=str(folder), hint=hint) from error
    return folder


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    path = folder / ".mlflow.lock"
    try:
        with FileLock(path, timeout=LOCK_SECONDS):
            yield
    except Timeout:
        what = f"another process has been opening this store for more than {LOCK_SECONDS} s"
        raise InputError(what, where=str(path), hint="end that process, then try again") from None
    except PermissionError as error:
        what, hint = "this folder cannot be written to", "choose another with tracking.root=DIR"
        raise InputError(what, where=str(folder), hint=hint) from error


@contextmanager
def _quiet() -> Iterator[None]:
    # MLflow tells of every table migration, and its own code trips a deprecation of SQLAlchemy
    # 2.1: neither is anything a user of ours can act on.
    logging.getLogger("mlflow.store.db.utils").setLevel(logging.WARNING)
    with warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore", message="The ``noload`` loader", category=DeprecationWarning
        )
        yield


def _experiment_id(client: "MlflowClient", name: str, artifacts: Path) -> str:
    found = client.get_experiment_by_name(name)
    if found is None:
        return str(client.create_experiment(name, artifact_location=str(artifacts)))
    hint = "choose another name with tracking.experiment=NAME"
    if found.lifecycle_stage != "active":
        raise InputError("this experiment was deleted in MLflow", where=name, hint=hint)
    if found.artifact_location != str(artifacts):
        what = f"this experiment keeps its artifacts elsewhere: {found.artifact_location}"
        raise InputError(what, where=name, hint=f"the store was moved or made by others; {hint}")
    return str(found.experiment_id)
