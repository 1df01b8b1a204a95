"""The parent run of an analysis: opened, or gone on with where an attempt was cut short."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from dashred.config import Config
from dashred.core.errors import InputError
from dashred.core.job_control import lock_folder
from dashred.core.mlflow.store import INTERRUPTED, Store, open_store, status_of
from dashred.core.mlflow.tracker import Tracker
from dashred.pipeline.run.run_manifest import begin, differences, point_to, pointed_to, read_began
from dashred.pipeline.run.run_tags import name_of


def experiment_of(config: Config) -> str:
    """Return the name of the experiment that a run belongs to."""
    return config.tracking.experiment or config.name


@contextmanager
def open_parent(
    config: Config, named: Path | None, began: dict[str, str]
) -> Iterator[tuple[Tracker, Path]]:
    """Open the run, or go on with the one that was cut short; yields it and its checkpoints.

    Args:
        config: which store, and the id of a run that is open already.
        named: the folder that the user named.
        began: what this attempt begins with.

    Raises:
        InputError: the run is worked on by another process, or what it was begun with has changed.
    """
    keep, experiment = config.tracking, experiment_of(config)
    store = open_store(keep.root, experiment)
    earlier = None if keep.run else cut_short(store, pointed_to(named), began)
    with ExitStack() as stack:
        if known := keep.run or earlier:
            # Before it is opened: one that another process works on must not be touched.
            stack.enter_context(lock_folder(store.checkpoints(known), "analysis"))
        opened = (
            Tracker.reopen(keep.root, experiment, earlier)
            if earlier
            else Tracker.open(keep.root, experiment, name_of(config), keep.run, parent=keep.parent)
        )
        run = stack.enter_context(opened)
        folder = store.checkpoints(run.run_id)
        if not known:
            stack.enter_context(lock_folder(folder, "analysis"))
        _begin(folder, config, began)
        if named is not None:
            point_to(named, run.run_id)
        yield run, folder


def cut_short(store: Store, run_id: str | None, began: dict[str, str]) -> str | None:
    """Return the id, if that run was cut short and began with the same input and code."""
    if run_id is None or status_of(store, run_id) not in INTERRUPTED:
        return None
    return run_id if read_began(store.checkpoints(run_id)) == began else None


def _begin(folder: Path, config: Config, began: dict[str, str]) -> None:
    before = read_began(folder)
    if before is None:
        begin(folder, config, began)
        return
    if changed := differences(before, began):
        raise InputError(
            f"this run cannot be gone on with: {'; '.join(changed)}",
            where=f"run {config.tracking.run}",
            hint="begin it anew, without resume=",
        )
