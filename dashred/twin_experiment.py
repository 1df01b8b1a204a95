"""A twin experiment: recorder, analysis and scorer, each a process of its own.

The analysis is handed the path of the recording and nothing else of the twin: not its name, not
its noise, not its random stream. The seal lies in a private folder until the findings are frozen.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from dashred.config import Config
from dashred.errors import DONE, OUR_FAILURE, WRONG_INPUT
from dashred.mlflow_store import Store, open_store
from dashred.output import named_output
from dashred.tracking import Tracker

OWN = ("output=", "tracking.run=", "tracking.parent=")
# Of what describes the twin, the step of the analysis clock alone is the analysis' business.
TWIN = "recording."
CLOCK = "recording.every="
# MLflow, with what it reaches an SQLite store by.
STORE = "mlflow.store.tracking.sqlalchemy_store"
# What each process needs sooner or later, beside its entry point's own imports.
NEEDED = {
    "record": ("dashred.sensing.write_netcdf", "dashred.physics.simulate"),
    "train": ("dashred.stages.report", STORE),
    "score": ("dashred.scoring", "dashred.reporting.figures", STORE),
}


class _EndedError(Exception):
    """A process of the experiment ended with an exit code that is not 0."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        # One that a signal has ended has a negative code, which no shell would show.
        self.code = code if code > 0 else OUR_FAILURE


def run_twin(config: Config, argv: list[str]) -> int:
    """Record, analyse, score; returns the exit code of the first process that fails."""
    words = [word for word in argv if not word.startswith(OWN)]
    named = named_output(config)
    with (
        tempfile.TemporaryDirectory(prefix="dashred-seal-") as private,
        tempfile.TemporaryDirectory(prefix="dashred-recording-") as open_to_all,
    ):
        try:
            _run(config, words, named, Path(private), Path(open_to_all))
        except _EndedError as ended:
            return ended.code
    return DONE


def _run(
    config: Config, words: list[str], named: Path | None, private: Path, open_to_all: Path
) -> None:
    experiment = config.tracking.experiment or config.name
    sealed, recording = private / "sealed.nc", open_to_all / "recording.nc"
    with _standby("record") as recorder, _standby("train") as analyser:
        _tell(recorder, [*words, f"output={private}"])
        # The store's schema takes seconds to create: time that the recorder needs anyway.
        store = open_store(config.tracking.root, experiment)
        _wait(recorder)
        shutil.move(private / "recording.nc", recording)
        with _open_run(config, experiment, store) as run, _standby("score") as scorer:
            output = named or run.artifact_dir
            told = words_of_analysis(words, recording, output)
            _tell(analyser, [*told, f"tracking.run={run.run_id}"])
            _wait(analyser)
            shutil.copyfile(recording, output / "recording.nc")
            place = [f"root={config.tracking.root}", f"experiment={experiment}"]
            place += [f"findings={output}", f"sealed={sealed}", f"run={run.run_id}"]
            _tell(scorer, place)
            _wait(scorer)
            shutil.copyfile(sealed, output / "sealed.nc")


def words_of_analysis(words: list[str], recording: Path, output: Path) -> list[str]:
    """Return what an analysis is told: nothing of the twin but where its recording lies."""
    told = [word for word in words if not word.startswith(TWIN) or word.startswith(CLOCK)]
    return [*told, f"recording.path={recording}", f"output={output}"]


@contextmanager
def _open_run(config: Config, experiment: str, store: Store) -> Iterator[Tracker]:
    """Open the parent run; where the input turns out to be wrong, nothing of it stays."""
    name = f"{config.name} seed {config.seed}"
    try:
        root, parent = config.tracking.root, config.tracking.parent
        with Tracker.open(root, experiment, name, parent=parent) as run:
            yield run
    except _EndedError as ended:
        if ended.code == WRONG_INPUT:
            store.client.delete_run(run.run_id)
            shutil.rmtree(run.artifact_dir.parent)
        raise


@contextmanager
def _standby(entry: str) -> Iterator[subprocess.Popen[str]]:
    """Get an entry point ready beside the block; at its end nothing of it is left running."""
    command = [sys.executable, "-m", "dashred.standby", f"dashred.{entry}", *NEEDED[entry]]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.terminate()
        process.wait()


def _tell(process: subprocess.Popen[str], words: list[str]) -> None:
    """Start an entry point on its words."""
    assert process.stdin is not None
    # One that has died meanwhile is told by its exit code.
    with suppress(BrokenPipeError), process.stdin as stdin:
        stdin.write(json.dumps(words) + "\n")


def _wait(process: subprocess.Popen[str]) -> None:
    """Wait for an entry point to end.

    Raises:
        _EndedError: with an exit code that is not 0.
    """
    if (code := process.wait()) != DONE:
        raise _EndedError(code)
