"""A twin experiment: recorder, analysis and scorer, each in its own process.

The analysis receives the path of the recording and nothing else of the twin: not its name, its
noise or its random stream. The seal stays in a private folder until the findings are frozen.
Nothing else of the twin is stored for a later resume.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dashred.config import Config, load_config
from dashred.core.command_line.arguments import COMMAND_LINE
from dashred.core.errors import DONE, WRONG_INPUT, InputError
from dashred.core.files.atomic import copy_atomic
from dashred.core.mlflow.store import Store, delete_run, open_store, status_of
from dashred.core.mlflow.tracker import Tracker
from dashred.evaluation.twins.seal_store import SEALED, delete_seal, find_seal, store_seal
from dashred.evaluation.twins.twin_file import read_entry
from dashred.pipeline.run.output_dir import named_output
from dashred.pipeline.run.parent_run import experiment_of, interrupted_run
from dashred.pipeline.run.processes import (
    ANALYSIS,
    STORE,
    ProcessFailedError,
    prewarmed,
    send_arguments,
    wait_for,
)
from dashred.pipeline.run.run_manifest import RECORDING as READ
from dashred.pipeline.run.run_manifest import manifest_of, read_manifest, read_pointer
from dashred.pipeline.run.run_tags import run_name
from dashred.reporting.figures.figure_names import OF_THE_TRUTH

OWN = ("output=", "tracking.run=", "tracking.parent=")
# Of the keys of the twin, the analysis receives only the step of its clock.
RECORDING = "recording.nc"
TWIN = "recording."
CLOCK = "recording.every="
RECORDER = (
    "dashred.evaluation.twins.record_command",
    *("dashred.data.io.write_netcdf", "dashred.physics.solvers.simulate"),
)
SCORER = (
    "dashred.evaluation.twins.score_command",
    *("dashred.evaluation.twins.scoring", "dashred.reporting.figures.save", STORE),
)


def run_twin(config: Config, argv: list[str]) -> int:
    """Record, analyse and score; return the exit code of the first process that fails.

    Raises:
        InputError: an argument sets `recording` as a whole, including keys of the twin.
    """
    if "recording" in (word.partition("=")[0] for word in argv):
        hint = "set its keys one by one: recording.noise=0.03 recording.sensors=12"
        raise InputError(
            "recording= as a whole cannot be set for a twin", where=COMMAND_LINE, hint=hint
        )
    assert config.recording.twin is not None
    read_entry(config, config.recording.twin)  # an unknown twin is refused before processes start
    words = [word for word in argv if not word.startswith(OWN)]
    named = named_output(config)
    with tempfile.TemporaryDirectory(prefix="dashred-seal-") as private:
        try:
            _run(config, words, named, Path(private))
        except ProcessFailedError as ended:
            return ended.code
    return DONE


def _run(config: Config, words: list[str], named: Path | None, private: Path) -> None:
    with prewarmed(*RECORDER) as recorder, prewarmed(*ANALYSIS) as analyser:
        send_arguments(recorder, [*words, f"output={private}"])
        # Creating the schema of the store takes seconds; the recorder runs meanwhile.
        tracking = config.tracking
        store = open_store(tracking.root, experiment_of(config), tracking.artifacts)
        wait_for(recorder)
        recording = private / RECORDING
        earlier = _interrupted_run(store, named, words, recording)
        with _open_run(config, store, earlier) as run, prewarmed(*SCORER) as scorer:
            store_seal(run.run_id, private / SEALED)
            own = Path(shutil.move(recording, run.artifact_dir / RECORDING))
            arguments = analysis_arguments(words, own, named or run.artifact_dir)
            if named is not None:
                clear_truth(named)
            send_arguments(analyser, [*arguments, f"tracking.run={run.run_id}"])
            wait_for(analyser)
            place = tracking.root, experiment_of(config)
            score(run, scorer, named or run.artifact_dir, *place)


def score_resumed(run: Tracker, output: Path, root: str, experiment: str) -> None:
    """Score a resumed twin experiment; do nothing for a run of a recording without a truth."""
    if find_seal(run.run_id):
        with prewarmed(*SCORER) as scorer:
            score(run, scorer, output, root, experiment)


def score(
    run: Tracker, scorer: subprocess.Popen[str], output: Path, root: str, experiment: str
) -> None:
    """Score the frozen findings; copy the recording and the truth to their folder."""
    if output.resolve() != run.artifact_dir.resolve():
        copy_atomic(run.artifact_dir / RECORDING, output / RECORDING)
    sealed = find_seal(run.run_id)
    assert sealed is not None
    place = [f"root={root}", f"experiment={experiment}", f"run={run.run_id}"]
    send_arguments(scorer, [*place, f"findings={output}", f"sealed={sealed}"])
    wait_for(scorer)
    copy_atomic(sealed, output / SEALED)
    delete_seal(run.run_id)


def clear_truth(output: Path) -> None:
    """Delete an earlier truth and its figures from the output folder before an analysis."""
    for name in (SEALED, *OF_THE_TRUTH):
        (output / name).unlink(missing_ok=True)


def analysis_arguments(words: list[str], recording: Path, output: Path) -> list[str]:
    """Return the arguments of the analysis: of the twin only the path of its recording."""
    arguments = [word for word in words if not word.startswith(TWIN) or word.startswith(CLOCK)]
    return [*arguments, f"recording.path={recording}", f"output={output}"]


def _interrupted_run(
    store: Store, named: Path | None, words: list[str], recording: Path
) -> str | None:
    """Return the interrupted run of this folder if it analysed the same recording."""
    run_id = read_pointer(named)
    if run_id is None or status_of(store, run_id) is None:
        return None
    before = store.artifact_dir(run_id) / RECORDING
    if not before.is_file() or before.read_bytes() != recording.read_bytes():
        return None
    config = load_config(analysis_arguments(words, before, before.parent), entry="train")
    manifest = read_manifest(store.checkpoints(run_id)) or {}
    return interrupted_run(store, run_id, manifest_of(config, manifest.get(READ, "")))


@contextmanager
def _open_run(config: Config, store: Store, earlier: str | None) -> Iterator[Tracker]:
    """Open the parent run; delete it if the input turns out to be wrong."""
    root, experiment, parent = config.tracking.root, experiment_of(config), config.tracking.parent
    opened = (
        Tracker.reopen(root, experiment, earlier)
        if earlier
        else Tracker.open(root, experiment, run_name(config), parent=parent)
    )
    try:
        with opened as run:
            yield run
    except ProcessFailedError as ended:
        # A run with a manifest had correct input and can be resumed.
        if ended.code == WRONG_INPUT and read_manifest(store.checkpoints(run.run_id)) is None:
            delete_run(store, run.run_id)
            shutil.rmtree(run.artifact_dir.parent)
            delete_seal(run.run_id)
        raise
