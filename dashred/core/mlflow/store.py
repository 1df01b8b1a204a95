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

from dashred.core.errors import InputError
from dashred.core.files.state_dir import state_folder
from dashred.core.files.user_path import is_server
from dashred.core.mlflow.server import open_server
from dashred.core.system_errors import RefusedError

if TYPE_CHECKING:
    from mlflow import MlflowClient

# MLflow reads these when it is imported, so here is the last moment to say no.
os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
os.environ.setdefault("DO_NOT_TRACK", "true")

LOCK_SECONDS = 120
CHOOSE = "choose another with tracking.root=DIR"
# What a run's status may be when it has not come to its end; after SIGKILL it still "runs".
INTERRUPTED = ("RUNNING", "FAILED", "KILLED", "SCHEDULED")


@dataclass(frozen=True)
class Store:
    """An open store and the experiment in it: `artifacts` is an absolute local folder.

    Attributes:
        remote: whether it is a server's, to which artifacts are sent; else `artifacts` is where
            MLflow itself looks for them.
    """

    client: "MlflowClient"
    uri: str
    artifacts: Path
    experiment_id: str
    remote: bool = False

    def artifact_dir(self, run_id: str) -> Path:
        """The local folder of a run's artifacts; created if new."""
        return _made(self.artifacts / run_id / "artifacts")

    def checkpoints(self, run_id: str) -> Path:
        """The folder of what a run that is cut short goes on from; created if new."""
        return _made(self.artifacts / run_id / "checkpoints")


def open_store(root: str, experiment: str) -> Store:
    """Open the store, creating folder, tables and experiment where they are missing.

    Args:
        root: its folder, or the URL of a tracking server.
        experiment: by name.

    Raises:
        InputError: if the folder or the database cannot be used, the server does not answer, or
            the experiment was deleted.
    """
    if is_server(root):
        client = open_server(root)
        with refusals_as_errors(root):
            found = _experiment_id(client, experiment, None)
        return Store(client, root, state_folder("runs"), found, remote=True)
    folder = _folder(root)
    artifacts = folder / "artifacts"
    with _locked(folder), _quiet(), refusals_as_errors(str(folder / "mlflow.db")):
        client = _local_client(folder)
        found = _experiment_id(client, experiment, artifacts)
    return Store(client, _uri(folder), artifacts, found)


def store_of_run(root: str, run_id: str) -> tuple[Store, str]:
    """Open the store that holds a run; returns the name of its experiment, too.

    Raises:
        InputError: there is no store, or no such run in it.
    """
    from mlflow.exceptions import MlflowException

    place = root if is_server(root) else str(Path(root) / "mlflow.db")
    if not is_server(root) and not Path(place).is_file():
        hint = "say where it is: tracking.root=DIR, or tracking.root=http://SERVER"
        raise InputError("there is no MLflow store here", where=place, hint=hint)
    client = open_server(root) if is_server(root) else _local_client(_folder(root))
    run = None
    with _quiet(), refusals_as_errors(place), suppress(MlflowException):
        run = client.get_run(run_id)
        experiment = client.get_experiment(run.info.experiment_id).name
    if run is None or run.info.lifecycle_stage != "active":
        hint = "MLflow's page of a run shows its id; another store is tracking.root=DIR"
        raise InputError(f"there is no run {run_id!r} in {place}", where="resume", hint=hint)
    return open_store(root, experiment), experiment


def status_of(store: Store, run_id: str) -> str | None:
    """RUNNING, FINISHED, FAILED or KILLED; None where the store has no such run."""
    from mlflow.exceptions import MlflowException

    try:
        info = store.client.get_run(run_id).info
    except MlflowException:
        return None
    return str(info.status) if info.lifecycle_stage == "active" else None


def tags_of(store: Store, run_id: str) -> dict[str, str]:
    """The tags of a run that the store has."""
    with refusals_as_errors(store.uri):
        return dict(store.client.get_run(run_id).data.tags)


@contextmanager
def refusals_as_errors(place: str) -> Iterator[None]:
    """Tell why MLflow refuses a store when it is opened, in one message: it is the user's choice.

    Raises:
        InputError: instead of MLflow's own exception.
    """
    from mlflow.exceptions import MlflowException
    from sqlalchemy.exc import SQLAlchemyError

    try:
        yield
    except (MlflowException, SQLAlchemyError) as error:
        raise InputError(_refusal(error), where=place, hint=CHOOSE) from error


@contextmanager
def refusals_as_failures(place: str, hint: str) -> Iterator[None]:
    """Tell what MLflow refuses a run that has begun (a locked database, a server that has gone).

    Raises:
        RefusedError: instead of MLflow's own exception; the input is as right as it was.
    """
    from mlflow.exceptions import MlflowException
    from sqlalchemy.exc import SQLAlchemyError

    try:
        yield
    except (MlflowException, SQLAlchemyError) as error:
        raise RefusedError(f"{place}: {_refusal(error)}\n  {hint}") from error


def _refusal(error: Exception) -> str:
    return f"MLflow cannot use this store: {str(error).splitlines()[0]}"


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


def _uri(folder: Path) -> str:
    return f"sqlite:///{folder / 'mlflow.db'}"


def _local_client(folder: Path) -> "MlflowClient":
    from mlflow import MlflowClient

    with _quiet():
        return MlflowClient(tracking_uri=_uri(folder))


def _made(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _folder(root: str) -> Path:
    folder = Path(root).resolve()
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


def _experiment_id(client: "MlflowClient", name: str, artifacts: Path | None) -> str:
    """The id of the experiment; `artifacts` is where they go, None where the server decides."""
    found = client.get_experiment_by_name(name)
    if found is None:
        location = None if artifacts is None else str(artifacts)
        return str(client.create_experiment(name, artifact_location=location))
    hint = "choose another name with tracking.experiment=NAME"
    if found.lifecycle_stage != "active":
        raise InputError("this experiment was deleted in MLflow", where=name, hint=hint)
    if artifacts is not None and found.artifact_location != str(artifacts):
        what = f"this experiment keeps its artifacts elsewhere: {found.artifact_location}"
        raise InputError(what, where=name, hint=f"the store was moved or made by others; {hint}")
    return str(found.experiment_id)
