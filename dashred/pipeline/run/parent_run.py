"""The MLflow parent run of an analysis: opened, or resumed after an interruption."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from dashred.config import Config
from dashred.core.errors import InputError
from dashred.core.job_control import lock_folder
from dashred.core.mlflow.store import INTERRUPTED, Store, open_store, status_of
from dashred.core.mlflow.store_requests import Requests
from dashred.core.mlflow.tracker import Tracker
from dashred.pipeline.run.run_manifest import (
    differences,
    read_manifest,
    read_pointer,
    write_manifest,
    write_pointer,
)
from dashred.pipeline.run.run_tags import run_name


def experiment_of(config: Config) -> str:
    """Return the name of the experiment that a run belongs to."""
    return config.tracking.experiment or config.name


@contextmanager
def open_parent(
    config: Config, named: Path | None, manifest: dict[str, str]
) -> Iterator[tuple[Tracker, Path]]:
    """Open a run, or resume an interrupted one; yield it and its checkpoint folder.

    Args:
        config: the configuration; it names the store and, optionally, the id of an open run.
        named: the output folder that the user named.
        manifest: the manifest of this attempt.

    Raises:
        InputError: another process is working on the run, or its manifest has changed.
    """
    tracking, experiment = config.tracking, experiment_of(config)
    # The simulations are done by now, so a server that is restarted is waited for.
    opening = Requests(tracking.root, "start the run again when the store is available")
    store = opening.send(lambda: open_store(tracking.root, experiment, tracking.artifacts))
    earlier = None if tracking.run else interrupted_run(store, read_pointer(named), manifest)
    with ExitStack() as stack:
        if run_id := tracking.run or earlier:
            # Locked before it is opened: a run that another process works on must not be touched.
            stack.enter_context(lock_folder(store.checkpoints(run_id), "analysis"))
        opened = (
            Tracker.reopen(tracking.root, experiment, earlier)
            if earlier
            else Tracker.open(
                tracking.root,
                experiment,
                run_name(config),
                tracking.run,
                parent=tracking.parent,
                artifacts=tracking.artifacts,
            )
        )
        run = stack.enter_context(opened)
        folder = store.checkpoints(run.run_id)
        if not run_id:
            stack.enter_context(lock_folder(folder, "analysis"))
        _check_or_write_manifest(folder, config, manifest)
        if named is not None:
            write_pointer(named, run.run_id)
        yield run, folder


def interrupted_run(store: Store, run_id: str | None, manifest: dict[str, str]) -> str | None:
    """Return the id if that run was interrupted and has the same manifest."""
    if run_id is None or status_of(store, run_id) not in INTERRUPTED:
        return None
    return run_id if read_manifest(store.checkpoints(run_id)) == manifest else None


def _check_or_write_manifest(folder: Path, config: Config, manifest: dict[str, str]) -> None:
    before = read_manifest(folder)
    if before is None:
        write_manifest(folder, config, manifest)
        return
    if changed := differences(before, manifest):
        raise InputError(
            f"this run cannot be resumed: {'; '.join(changed)}",
            where=f"run {config.tracking.run}",
            hint="start a new run, without resume=",
        )
