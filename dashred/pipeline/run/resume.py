"""Resume a run that was interrupted: ``dashred train resume=RUN_ID``.

The analysis is a process of its own. It gets the configuration that the run began with, and nothing
else.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from dashred.config.bundled_systems import BASE, results_root
from dashred.config.layers import absolute_path, store_root
from dashred.config.source import read_file
from dashred.core.arguments import PLACE, Command, declared, pairs, word
from dashred.core.errors import DONE, InputError, nearest
from dashred.core.files.user_path import is_server
from dashred.core.job_control import lock_folder
from dashred.core.mlflow.store import INTERRUPTED, Store, status_of, store_of_run, tags_of
from dashred.core.mlflow.tracker import Tracker
from dashred.pipeline.run.output_dir import make_output
from dashred.pipeline.run.processes import ANALYSIS, EndedError, prewarmed, tell, wait
from dashred.pipeline.run.run_manifest import (
    FROZEN,
    differences,
    end,
    present,
    read_began,
    words_of,
)


@dataclass(frozen=True, kw_only=True)
class Words:
    """The words that go with ``resume=``."""

    resume: str = word(str, "RUN_ID", "the run")
    output: str | None = word(str, "DIR", "folder of the findings", default=None)
    root: str | None = word(
        str, "DIR", "folder of the MLflow store", name="tracking.root", default=None
    )
    trust: str | None = word(
        str, "MODULE.CLASS", "the system's Python class, whose code may run", default=None
    )


COMMAND = Command(
    "dashred train",
    Words,
    "Resumes a run that was interrupted, with the configuration that it began with.",
)


def resume(argv: list[str], conclude: Callable[[Tracker, Path, str, str], None]) -> int:
    """Resume a run; return the exit code of the first process that fails.

    Args:
        argv: the words of the command line.
        conclude: what is done after the analysis, with the run, the folder of its findings, the
            MLflow store and the experiment.

    Raises:
        InputError: there is no such run, it has ended, another process works on it, or what it
            began with is not there any more.
    """
    words = read_words(argv)
    run_id, root = words.resume, _root(words.root)
    store, experiment = store_of_run(root, run_id)
    _refuse_finished(store, run_id)
    folder, analysed = store.checkpoints(run_id), FROZEN in tags_of(store, run_id)
    told = [] if analysed else _told(folder, run_id)
    with lock_folder(folder, "analysis"):
        pass
    output = make_output(named_folder(words.output)) if words.output else store.artifact_dir(run_id)
    told += [f"trust={words.trust}"] if words.trust else []
    told += [f"output={output}", f"tracking.root={root}", f"tracking.experiment={experiment}"]
    try:
        with Tracker.reopen(root, experiment, run_id) as run:
            if analysed:
                run.fetch_artifacts(output)
            else:
                with prewarmed(*ANALYSIS) as analyser:
                    tell(analyser, [*told, f"tracking.run={run_id}"])
                    wait(analyser)
            conclude(run, output, root, experiment)
    except EndedError as ended:
        return ended.code
    end(folder, output)
    return DONE


def read_words(argv: list[str]) -> Words:
    """Return the words of the command line.

    Raises:
        InputError: one that does not go with ``resume=``, is empty, or is given twice.
    """
    known = [one.name for one in declared(Words)]
    for key, _ in pairs(argv):
        if key not in known:
            what = f"resume= does not go with {key}="
            hint = "the run is resumed with the configuration that it began with"
            raise InputError(what, where=PLACE, hint=f"{hint}; {nearest(key, known)}")
    return COMMAND.read(argv)


def named_folder(output: str) -> str:
    """Return the folder of ``output=`` as it is from anywhere, the home folder spelt out."""
    return absolute_path(output, folder=Path.cwd(), where=PLACE)


def _root(named: str | None) -> str:
    if named is None:
        default = str(read_file(BASE, label="conf/base.yaml").values["tracking"]["root"])
        return str((results_root() / default).resolve())
    root = store_root(named, folder=Path.cwd(), where=PLACE)
    return root if is_server(root) else str(Path(root).resolve())


def _refuse_finished(store: Store, run_id: str) -> None:
    if status_of(store, run_id) not in INTERRUPTED:
        raise InputError(
            "this run has come to its end: there is nothing to go on with",
            where=f"run {run_id}",
            hint=f"what it found: {store.artifact_dir(run_id)}",
        )


def _told(folder: Path, run_id: str) -> list[str]:
    """Return the words of the analysis: the configuration that it began with."""
    words, began = words_of(folder), read_began(folder)
    if words is None or began is None:
        raise InputError(
            "this run left nothing to go on with",
            where=f"run {run_id}",
            hint="it was cut short before it began, or on another machine: begin it anew",
        )
    if changed := differences(began, present()):
        raise InputError(
            f"this run cannot be gone on with: {'; '.join(changed)}",
            where=f"run {run_id}",
            hint="go back to what it began with, or begin it anew, without resume=",
        )
    return words
