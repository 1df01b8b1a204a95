"""A twin experiment: recorder, analysis and scorer, each a process of its own.

The analysis is handed the path of the recording and nothing else of the twin: not its name, not
its noise, not its random stream. The seal lies in a private folder until the findings are frozen,
and nothing else of the twin is kept for an experiment that is cut short.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dashred.config import Config, load_config
from dashred.core.arguments import PLACE
from dashred.core.errors import DONE, WRONG_INPUT, InputError
from dashred.core.files.atomic import copy_atomic
from dashred.core.mlflow.store import Store, open_store, status_of
from dashred.core.mlflow.tracker import Tracker
from dashred.evaluation.twins.kept_seal import SEALED, drop_seal, keep_seal, kept_seal
from dashred.evaluation.twins.twin_file import entry_of
from dashred.pipeline.run.output_dir import named_output
from dashred.pipeline.run.parent_run import cut_short, experiment_of
from dashred.pipeline.run.processes import ANALYSIS, STORE, EndedError, prewarmed, tell, wait
from dashred.pipeline.run.run_manifest import RECORDING as READ
from dashred.pipeline.run.run_manifest import manifest_of, pointed_to, read_began
from dashred.pipeline.run.run_tags import name_of
from dashred.reporting.figures.figure_names import OF_THE_TRUTH

OWN = ("output=", "tracking.run=", "tracking.parent=")
# Of what describes the twin, the step of the analysis clock alone is the analysis' business.
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
    """Record, analyse, score; returns the exit code of the first process that fails.

    Raises:
        InputError: a word sets the recording's keys together, those of the twin among them.
    """
    if "recording" in (word.partition("=")[0] for word in argv):
        hint = "set its keys one by one: recording.noise=0.03 recording.sensors=12"
        raise InputError("of a twin, recording= as a whole is not taken", where=PLACE, hint=hint)
    assert config.recording.twin is not None
    entry_of(config, config.recording.twin)  # refused by name before processes begin
    words = [word for word in argv if not word.startswith(OWN)]
    named = named_output(config)
    with tempfile.TemporaryDirectory(prefix="dashred-seal-") as private:
        try:
            _run(config, words, named, Path(private))
        except EndedError as ended:
            return ended.code
    return DONE


def _run(config: Config, words: list[str], named: Path | None, private: Path) -> None:
    with prewarmed(*RECORDER) as recorder, prewarmed(*ANALYSIS) as analyser:
        tell(recorder, [*words, f"output={private}"])
        # The store's schema takes seconds to create: time that the recorder needs anyway.
        store = open_store(config.tracking.root, experiment_of(config))
        wait(recorder)
        recording = private / RECORDING
        earlier = _cut_short(store, named, words, recording)
        with _open_run(config, store, earlier) as run, prewarmed(*SCORER) as scorer:
            keep_seal(run.run_id, private / SEALED)
            own = Path(shutil.move(recording, run.artifact_dir / RECORDING))
            told = words_of_analysis(words, own, named or run.artifact_dir)
            if named is not None:
                clear_scored(named)
            tell(analyser, [*told, f"tracking.run={run.run_id}"])
            wait(analyser)
            place = config.tracking.root, experiment_of(config)
            score(run, scorer, named or run.artifact_dir, *place)


def score_if_sealed(run: Tracker, output: Path, root: str, experiment: str) -> None:
    """Score a resumed twin experiment; do nothing for a run of a recording without a truth."""
    if kept_seal(run.run_id):
        with prewarmed(*SCORER) as scorer:
            score(run, scorer, output, root, experiment)


def score(
    run: Tracker, scorer: subprocess.Popen[str], output: Path, root: str, experiment: str
) -> None:
    """Open the seal over the frozen findings; recording and truth then lie beside them."""
    if output.resolve() != run.artifact_dir.resolve():
        copy_atomic(run.artifact_dir / RECORDING, output / RECORDING)
    sealed = kept_seal(run.run_id)
    assert sealed is not None
    place = [f"root={root}", f"experiment={experiment}", f"run={run.run_id}"]
    tell(scorer, [*place, f"findings={output}", f"sealed={sealed}"])
    wait(scorer)
    copy_atomic(sealed, output / SEALED)
    drop_seal(run.run_id)


def clear_scored(output: Path) -> None:
    """Take an earlier truth, and what shows it, out of the folder of an analysis that begins."""
    for name in (SEALED, *OF_THE_TRUTH):
        (output / name).unlink(missing_ok=True)


def words_of_analysis(words: list[str], recording: Path, output: Path) -> list[str]:
    """Return what an analysis is told: nothing of the twin but where its recording lies."""
    told = [word for word in words if not word.startswith(TWIN) or word.startswith(CLOCK)]
    return [*told, f"recording.path={recording}", f"output={output}"]


def _cut_short(store: Store, named: Path | None, words: list[str], recording: Path) -> str | None:
    """Return the run that was cut short in this folder, if it analysed this very recording."""
    run_id = pointed_to(named)
    if run_id is None or status_of(store, run_id) is None:
        return None
    before = store.artifact_dir(run_id) / RECORDING
    if not before.is_file() or before.read_bytes() != recording.read_bytes():
        return None
    config = load_config(words_of_analysis(words, before, before.parent), entry="train")
    began = read_began(store.checkpoints(run_id)) or {}
    return cut_short(store, run_id, manifest_of(config, began.get(READ, "")))


@contextmanager
def _open_run(config: Config, store: Store, earlier: str | None) -> Iterator[Tracker]:
    """Open the parent run; where the input turns out to be wrong, nothing of it stays."""
    root, experiment, parent = config.tracking.root, experiment_of(config), config.tracking.parent
    opened = (
        Tracker.reopen(root, experiment, earlier)
        if earlier
        else Tracker.open(root, experiment, name_of(config), parent=parent)
    )
    try:
        with opened as run:
            yield run
    except EndedError as ended:
        # What has begun was right; it can be gone on with.
        if ended.code == WRONG_INPUT and read_began(store.checkpoints(run.run_id)) is None:
            store.client.delete_run(run.run_id)
            shutil.rmtree(run.artifact_dir.parent)
            drop_seal(run.run_id)
        raise
