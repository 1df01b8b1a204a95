"""The MLflow store on disk: ``ROOT/mlflow.db``, with artifacts under ``ROOT/artifacts``.

Several processes may open a new store at the same time. MLflow creates the tables without a lock,
so a store is opened under a file lock.
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
from dashred.core.files.user_path import is_server
from dashred.core.mlflow.server import open_server
from dashred.core.system_errors import ExternalServiceError

if TYPE_CHECKING:
    from mlflow import MlflowClient

# MLflow reads these when it is imported, so they must be set before.
os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
os.environ.setdefault("DO_NOT_TRACK", "true")

LOCK_SECONDS = 120
CHOOSE = "choose another with tracking.root=DIR"
# Status of a run that has not finished; after SIGKILL the status is still RUNNING.
INTERRUPTED = ("RUNNING", "FAILED", "KILLED", "SCHEDULED")


@dataclass(frozen=True)
class Store:
    """An open store and an experiment in it.

    Attributes:
        client: of the store.
        uri: of the store.
        artifacts: absolute local folder.
        experiment_id: of the experiment.
        remote: whether the store is a server, to which artifacts are sent; otherwise MLflow
            reads them from ``artifacts``.
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


def open_store(root: str, experiment: str) -> Store:
    """Open the store; create the folder, the tables and the experiment if they are missing.

    Args:
        root: folder of the store, or the URL of a tracking server.
        experiment: name of the experiment.

    Raises:
        InputError: the folder or the database cannot be used, the server does not respond, or
            the experiment was deleted.
    """
    if is_server(root):
        client = open_server(root)
        with mlflow_input_errors(root):
            found = _experiment_id(client, experiment, None)
        return Store(client, root, state_folder("runs"), found, remote=True)
    folder = _folder(root)
    artifacts = folder / "artifacts"
    with _locked(folder), _quiet(), mlflow_input_errors(str(folder / "mlflow.db")):
        client = _local_client(folder)
        found = _experiment_id(client, experiment, artifacts)
    return Store(client, _uri(folder), artifacts, found)


def store_of_run(root: str, run_id: str) -> tuple[Store, str]:
    """Open the store that holds a run; return it with the name of the run's experiment.

    Raises:
        InputError: there is no store, or the store has no such run.
    """
    from mlflow.exceptions import MlflowException

    place = root if is_server(root) else str(Path(root) / "mlflow.db")
    if not is_server(root) and not Path(place).is_file():
        hint = "give its location with tracking.root=DIR or tracking.root=http://SERVER"
        raise InputError("there is no MLflow store here", where=place, hint=hint)
    client = open_server(root) if is_server(root) else _local_client(_folder(root))
    run = None
    with _quiet(), mlflow_input_errors(place), suppress(MlflowException):
        run = client.get_run(run_id)
        experiment = client.get_experiment(run.info.experiment_id).name
    if run is None or run.info.lifecycle_stage != "active":
        hint = "MLflow's page of a run shows its id; choose another store with tracking.root=DIR"
        raise InputError(f"there is no run {run_id!r} in {place}", where="resume", hint=hint)
    return open_store(root, experiment), experiment


def status_of(store: Store, run_id: str) -> str | None:
    """Return RUNNING, FINISHED, FAILED or KILLED; None if the store has no such run."""
    from mlflow.exceptions import MlflowException

    try:
        info = store.client.get_run(run_id).info
    except MlflowException:
        return None
    return str(info.status) if info.lifecycle_stage == "active" else None


def tags_of(store: Store, run_id: str) -> dict[str, str]:
    """Return the tags of an existing run."""
    with mlflow_input_errors(store.uri):
        return dict(store.client.get_run(run_id).data.tags)


@contextmanager
def mlflow_input_errors(place: str) -> Iterator[None]:
    """Convert MLflow's errors on opening a store to InputError: the user has chosen the store.

    Raises:
        InputError: instead of MLflow's own exception.
    """
    from mlflow.exceptions import MlflowException
    from sqlalchemy.exc import SQLAlchemyError

    try:
        yield
    except (MlflowException, SQLAlchemyError) as error:
        raise InputError(_mlflow_message(error), where=place, hint=CHOOSE) from error


@contextmanager
def mlflow_service_errors(place: str, hint: str) -> Iterator[None]:
    """Convert the errors of MLflow during a run, such as a locked database or a lost connection.

    Raises:
        RefusedError: instead of MLflow's own exception.
    """
    from mlflow.exceptions import MlflowException
    from sqlalchemy.exc import SQLAlchemyError

    try:
        yield
    except (MlflowException, SQLAlchemyError) as error:
        raise ExternalServiceError(f"{place}: {_mlflow_message(error)}\n  {hint}") from error


def _mlflow_message(error: Exception) -> str:
    return f"MLflow cannot use this store: {str(error).splitlines()[0]}"


def find_run(store: Store, run_id: str, *, key: str = "tracking.run") -> str:
    """Check that the store has a run, and return its id.

    Args:
        store: to search.
        run_id: of the run.
        key: configuration key that gave the id, for error messages.

    Raises:
        InputError: there is no such run, or it was deleted.
    """
    from mlflow.exceptions import MlflowException

    try:
        found = store.client.get_run(run_id).info.lifecycle_stage == "active"
    except MlflowException:
        found = False
    if not found:
        hint = f"omit {key} to open a new run"
        raise InputError(f"there is no run {run_id!r} in {store.uri}", where=key, hint=hint)
    return run_id


def end_failed_run(store: Store, run_id: str, *, killed: bool) -> None:
    """Mark a run FAILED or KILLED; an error of the store must not hide the original failure."""
    from mlflow.exceptions import MlflowException

    with suppress(MlflowException):
        store.client.set_terminated(run_id, "KILLED" if killed else "FAILED")


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
    # MLflow logs every table migration, and its code triggers a deprecation warning of SQLAlchemy
    # 2.1. Users cannot act on either.
    logging.getLogger("mlflow.store.db.utils").setLevel(logging.WARNING)
    with warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore", message="The ``noload`` loader", category=DeprecationWarning
        )
        yield


def _experiment_id(client: "MlflowClient", name: str, artifacts: Path | None) -> str:
    """Return the id of the experiment; ``artifacts`` is None if the server chooses the folder."""
    found = client.get_experiment_by_name(name)
    if found is None:
        location = None if artifacts is None else str(artifacts)
        return str(client.create_experiment(name, artifact_location=location))
    hint = "choose another name with tracking.experiment=NAME"
    if found.lifecycle_stage != "active":
        raise InputError("this experiment was deleted in MLflow", where=name, hint=hint)
    if artifacts is not None and found.artifact_location != str(artifacts):
        what = f"the artifacts of this experiment are elsewhere: {found.artifact_location}"
        moved = "the store was moved or created by another program"
        raise InputError(what, where=name, hint=f"{moved}; {hint}")
    return str(found.experiment_id)
