"""The MLflow store of a run: a folder, a tracking server, or a database with a bucket.

A folder holds ``ROOT/mlflow.db``, and artifacts under ``ROOT/artifacts``. Several processes may
open a new store at the same time. MLflow creates the tables without a lock, so a store is opened
under a lock: of a file in the folder, or of the database.
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

from dashred.core.errors import InputError
from dashred.core.files.state_dir import state_folder
from dashred.core.mlflow import database
from dashred.core.mlflow.bucket import check_bucket, is_bucket
from dashred.core.mlflow.connection_errors import (
    StoreUnreachableError,
    first_line,
    is_outage,
    store_exceptions,
)
from dashred.core.mlflow.experiment import find_experiment
from dashred.core.mlflow.server import open_server
from dashred.core.mlflow.store_address import is_database, is_server

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import RunInfo

# MLflow reads these when it is imported, so they must be set before.
os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
os.environ.setdefault("DO_NOT_TRACK", "true")

LOCK_SECONDS = 120
NOISY = ("mlflow.store.db.utils", "alembic", "urllib3.connectionpool")
CHOOSE = "choose another with tracking.root=DIR"
# Status of a run that has not finished; after SIGKILL the status is still RUNNING.
INTERRUPTED = ("RUNNING", "FAILED", "KILLED", "SCHEDULED")


@dataclass(frozen=True)
class Store:
    """An open store and an experiment in it.

    Attributes:
        client: of the store.
        uri: of the store, as ``mlflow ui --backend-store-uri`` takes it.
        artifacts: absolute local folder.
        experiment_id: of the experiment.
        remote: whether the store is a server or a database, and artifacts are sent; otherwise
            MLflow reads them from ``artifacts``.
    """

    client: "MlflowClient"
    uri: str
    artifacts: Path
    experiment_id: str
    remote: bool = False

    def artifact_dir(self, run_id: str) -> Path:
        """Return the local folder of a run's artifacts; it is created if missing."""
        return _create_folder(self.artifacts / run_id / "artifacts")

    def checkpoints(self, run_id: str) -> Path:
        """Return the folder of a run's checkpoints; it is created if missing."""
        return _create_folder(self.artifacts / run_id / "checkpoints")

    def unsent(self, run_id: str) -> Path:
        """Return the file of what a run could not send; it is there only after an outage."""
        return self.artifacts / run_id / "unsent.json"


def open_store(root: str, experiment: str, artifacts: str | None = None) -> Store:
    """Open the store; create the folder, the tables and the experiment if they are missing.

    Args:
        root: folder of the store, or the address of a tracking server or of a database.
        experiment: name of the experiment.
        artifacts: bucket of a database; None if it has the experiment already.

    Raises:
        InputError: the folder, the database or the bucket cannot be used, the server does not
            respond, or the experiment was deleted.
    """
    if is_server(root):
        return _open_remote(root, experiment, artifacts)
    folder = _folder(root)
    place = folder / "artifacts"
    with _locked(folder), _quiet(), mlflow_input_errors(str(folder / "mlflow.db")):
        client = _local_client(folder)
        found = find_experiment(client, experiment, str(place))
    return Store(client, _uri(folder), place, str(found.experiment_id))


def _open_remote(root: str, experiment: str, artifacts: str | None) -> Store:
    with _quiet(), mlflow_input_errors(root):
        if is_database(root):
            with database.opening(root, artifacts) as client:
                found = find_experiment(client, experiment, artifacts, must_exist=artifacts is None)
        else:
            client = open_server(root)
            found = find_experiment(client, experiment, None)
    if is_bucket(found.artifact_location):
        check_bucket(found.artifact_location)
    return Store(client, root, state_folder("runs"), str(found.experiment_id), remote=True)


def store_of_run(root: str, run_id: str) -> tuple[Store, str]:
    """Open the store that holds a run; return it with the name of the run's experiment.

    Raises:
        InputError: there is no store, or the store has no such run.
    """
    place = root if is_server(root) else str(Path(root) / "mlflow.db")
    if not is_server(root) and not Path(place).is_file():
        hint = "give its location with tracking.root=DIR or tracking.root=http://SERVER"
        raise InputError("there is no MLflow store here", where=place, hint=hint)
    with _quiet(), mlflow_input_errors(place):
        client = _existing_client(root)
        found = _active_run(client, run_id)
        experiment = None if found is None else client.get_experiment(found.experiment_id).name
    if experiment is None:
        hint = "MLflow's page of a run shows its id; choose another store with tracking.root=DIR"
        raise InputError(f"there is no run {run_id!r} in {place}", where="resume", hint=hint)
    return open_store(root, experiment), experiment


def _existing_client(root: str) -> "MlflowClient":
    if not is_server(root):
        return _local_client(_folder(root))
    if not is_database(root):
        return open_server(root)
    with database.opening(root, None) as client:
        return client


def status_of(store: Store, run_id: str) -> str | None:
    """Return RUNNING, FINISHED, FAILED or KILLED; None if the store has no such run."""
    with mlflow_input_errors(store.uri):
        found = _active_run(store.client, run_id)
    return None if found is None else str(found.status)


def tags_of(store: Store, run_id: str) -> dict[str, str]:
    """Return the tags of an existing run."""
    with mlflow_input_errors(store.uri):
        return dict(store.client.get_run(run_id).data.tags)


@contextmanager
def mlflow_input_errors(place: str) -> Iterator[None]:
    """Convert MLflow's errors on opening a store to InputError: the user has chosen the store.

    Raises:
        InputError: instead of MLflow's own exception.
        StoreUnreachableError: the store may answer later.
    """
    try:
        yield
    except InputError:
        raise
    except store_exceptions() as error:
        kind = StoreUnreachableError if is_outage(error) else InputError
        what = f"MLflow cannot use this store: {first_line(error)}"
        raise kind(what, where=place, hint=CHOOSE) from error


def find_run(store: Store, run_id: str, *, key: str = "tracking.run") -> str:
    """Check that the store has a run, and return its id.

    Args:
        store: to search.
        run_id: of the run.
        key: configuration key that gave the id, for error messages.

    Raises:
        InputError: there is no such run, or it was deleted.
    """
    with mlflow_input_errors(store.uri):
        found = _active_run(store.client, run_id)
    if found is None:
        hint = f"omit {key} to open a new run"
        raise InputError(f"there is no run {run_id!r} in {store.uri}", where=key, hint=hint)
    return run_id


def end_failed_run(store: Store, run_id: str, *, killed: bool) -> None:
    """Mark a run FAILED or KILLED; an error of the store must not hide the original failure."""
    with suppress(*store_exceptions()):
        store.client.set_terminated(run_id, "KILLED" if killed else "FAILED")


def delete_run(store: Store, run_id: str) -> None:
    """Delete a run; an error of the store must not hide the original failure."""
    with suppress(*store_exceptions()):
        store.client.delete_run(run_id)


def _active_run(client: "MlflowClient", run_id: str) -> "RunInfo | None":
    """Return a run; None if there is none or it was deleted."""
    from mlflow.exceptions import MlflowException

    try:
        found = client.get_run(run_id).info
    except MlflowException as error:
        if is_outage(error):
            raise
        return None
    return found if found.lifecycle_stage == "active" else None


def _uri(folder: Path) -> str:
    return f"sqlite:///{folder / 'mlflow.db'}"


def _local_client(folder: Path) -> "MlflowClient":
    from mlflow import MlflowClient

    with _quiet():
        return MlflowClient(tracking_uri=_uri(folder))


def _create_folder(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _folder(root: str) -> Path:
    folder = Path(root).resolve()
    hint = "choose another folder with tracking.root=DIR"
    # MLflow treats the path as a URI: it would cut it at ? and decode %.
    if {"?", "%"} & set(str(folder)):
        raise InputError("MLflow cannot use a path with ? or %", where=str(folder), hint=hint)
    try:
        (folder / "artifacts").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        what = f"no MLflow store can be created here: {error.strerror}"
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
    # MLflow logs every table migration and every error of the database with its traceback, urllib3
    # every attempt, and MLflow's code triggers a deprecation warning of SQLAlchemy 2.1. Users
    # cannot act on any of it. The logs stay silent: errors of the store are messages of their own.
    for name in NOISY:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore", message="The ``noload`` loader", category=DeprecationWarning
        )
        yield
