"""Resume a run that was interrupted: ``dashred train resume=RUN_ID``.

The analysis runs in its own process, with the configuration with which the run was started.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from dashred.config.bundled_systems import BASE, results_root
from dashred.config.layers import absolute_path, store_root
from dashred.config.source import read_file
from dashred.core.command_line.arguments import (
    COMMAND_LINE,
    Command,
    argument,
    declared_arguments,
    key_value_pairs,
)
from dashred.core.errors import DONE, InputError, nearest
from dashred.core.job_control import lock_folder
from dashred.core.mlflow.store import INTERRUPTED, Store, status_of, store_of_run, tags_of
from dashred.core.mlflow.store_address import is_server
from dashred.core.mlflow.tracker import Tracker
from dashred.pipeline.run.output_dir import make_output
from dashred.pipeline.run.processes import (
    ANALYSIS,
    ProcessFailedError,
    prewarmed,
    send_arguments,
    wait_for,
)
from dashred.pipeline.run.run_manifest import (
    FROZEN,
    differences,
    environment_manifest,
    read_manifest,
    remove_checkpoints,
    stored_arguments,
)


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The words that go with ``resume=``."""

    resume: str = argument(str, "RUN_ID", "the run")
    output: str | None = argument(str, "DIR", "folder of the findings", default=None)
    root: str | None = argument(
        str, "DIR", "folder of the MLflow store", name="tracking.root", default=None
    )
    trust: str | None = argument(
        str, "NAME", "the system's class or simulator, whose code may run", default=None
    )


COMMAND = Command(
    "dashred train",
    Arguments,
    "Resumes a run that was interrupted, with the configuration that it began with.",
)


def resume(argv: list[str], conclude: Callable[[Tracker, Path, str, str], None]) -> int:
    """Resume a run; return the exit code of the first process that fails.

    Args:
        argv: arguments of the command line.
        conclude: called after the analysis with the run, the folder of its findings, the MLflow
            store and the experiment.

    Raises:
        InputError: the run does not exist or has finished, another process is working on it, or
            its input or code has changed.
    """
    words = read_words(argv)
    run_id, root = words.resume, _root(words.root)
    store, experiment = store_of_run(root, run_id)
    _refuse_finished(store, run_id)
    folder, analysed = store.checkpoints(run_id), FROZEN in tags_of(store, run_id)
    arguments = [] if analysed else _read_arguments(folder, run_id)
    with lock_folder(folder, "analysis"):
        pass
    output = make_output(named_folder(words.output)) if words.output else store.artifact_dir(run_id)
    arguments += [f"trust={words.trust}"] if words.trust else []
    arguments += [f"output={output}", f"tracking.root={root}", f"tracking.experiment={experiment}"]
    try:
        with Tracker.reopen(root, experiment, run_id) as run:
            if analysed:
                run.fetch_artifacts(output)
            else:
                with prewarmed(*ANALYSIS) as analyser:
                    send_arguments(analyser, [*arguments, f"tracking.run={run_id}"])
                    wait_for(analyser)
            conclude(run, output, root, experiment)
    except ProcessFailedError as ended:
        return ended.code
    remove_checkpoints(folder, output)
    return DONE


def read_words(argv: list[str]) -> Arguments:
    """Read the arguments of the command line.

    Raises:
        InputError: an argument cannot be combined with ``resume=``, is empty, or is given twice.
    """
    known = [field.name for field in declared_arguments(Arguments)]
    for key, _ in key_value_pairs(argv):
        if key not in known:
            what = f"resume= cannot be combined with {key}="
            hint = "a run is resumed with its own configuration"
            raise InputError(what, where=COMMAND_LINE, hint=f"{hint}; {nearest(key, known)}")
    return COMMAND.read(argv)


def named_folder(output: str) -> str:
    """Return the absolute path of ``output=``, with the home folder expanded."""
    return absolute_path(output, folder=Path.cwd(), where=COMMAND_LINE)


def _root(named: str | None) -> str:
    if named is None:
        default = str(read_file(BASE, label="conf/base.yaml").values["tracking"]["root"])
        return str((results_root() / default).resolve())
    root = store_root(named, folder=Path.cwd(), where=COMMAND_LINE)
    return root if is_server(root) else str(Path(root).resolve())


def _refuse_finished(store: Store, run_id: str) -> None:
    if status_of(store, run_id) not in INTERRUPTED:
        raise InputError(
            "this run has finished and cannot be resumed",
            where=f"run {run_id}",
            hint=f"its results: {store.artifact_dir(run_id)}",
        )


def _read_arguments(folder: Path, run_id: str) -> list[str]:
    """Return the arguments of the analysis: its original configuration."""
    words, manifest = stored_arguments(folder), read_manifest(folder)
    if words is None or manifest is None:
        raise InputError(
            "this run has no checkpoints to resume from",
            where=f"run {run_id}",
            hint="it ended before its analysis started, or on another machine: start a new run",
        )
    if changed := differences(manifest, environment_manifest()):
        raise InputError(
            f"this run cannot be resumed: {'; '.join(changed)}",
            where=f"run {run_id}",
            hint="restore its original input and code, or start a new run without resume=",
        )
    return words
