"""A run that is killed at any point: the same command again gives the same findings."""

from __future__ import annotations

import json
import shutil
import signal
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from dashred.pipeline.run.run_manifest import read_pointer
from tests.conftest import Ended, run_command
from tests.support.killing import kill_when, start

# What the run prints when a stage ends, or the file that it has begun to write.
PRINTED = (
    "check the resolution",
    "train SHRED",
    "assimilate",
    "grow the horizon",
    "compare hypotheses",
    "train corrected",
)
WRITTEN = (".estimates.nc.*.partial", "findings.json", "evidence.png", "report.html")
# A file that is being written is there for milliseconds: on a busy machine a run may be past it.
TRIES = 4


@pytest.mark.slow
@pytest.mark.parametrize("point", [*PRINTED, *WRITTEN])
def test_the_same_command_after_a_kill_gives_the_same_findings(
    point: str, quick: Path, twin_run: Ended, tmp_path: Path
) -> None:
    words = [f"conf={quick}", f"recording.path={twin_run.output / 'recording.nc'}"]
    killed_at(point, tmp_path, words)
    again = run_command(tmp_path, *words)
    assert again.code == 0, again.err
    assert again.read("findings.json") == twin_run.read("findings.json")
    assert not list(again.output.glob(".*.partial"))


@pytest.mark.slow
@pytest.mark.parametrize("point", [*PRINTED[1:], *WRITTEN])
def test_a_killed_run_is_resumed_by_its_name_to_the_same_findings(
    point: str, quick: Path, twin_run: Ended, tmp_path: Path
) -> None:
    """Which also logs the surrogate, once, whatever the attempts."""
    words = [f"conf={quick}", f"recording.path={twin_run.output / 'recording.nc'}"]
    killed_at(point, tmp_path, [*words, "tracking.model=true"])
    run_id = read_pointer(tmp_path / "output")
    again = run_command(tmp_path, f"resume={run_id}")
    assert again.code == 0, again.err
    assert again.read("findings.json") == twin_run.read("findings.json")
    assert json.loads(again.read("run.json"))["mlflow_run"] == run_id
    with closing(sqlite3.connect(again.root / "mlflow.db")) as database:
        [models] = database.execute("select count(*) from logged_models where status = 2")
    assert models == (1,)


def killed_at(point: str, folder: Path, words: list[str]) -> None:
    """Begin a run with its output in a folder, and kill it when it has got so far."""
    output = folder / "output"

    def reached(printed: list[str]) -> bool:
        if point in PRINTED:
            return any(point in line for line in printed)
        return any(output.glob(point))

    for _ in range(TRIES):
        shutil.rmtree(folder / "mlruns", ignore_errors=True)
        shutil.rmtree(output, ignore_errors=True)
        process = start([*words, f"output={output}", f"tracking.root={folder / 'mlruns'}"])
        printed, left = kill_when(process, reached)
        if process.returncode == -signal.SIGKILL:
            break
    assert process.returncode == -signal.SIGKILL and not left, "".join(printed)
    assert not (output / "run.json").exists()


@pytest.mark.slow
def test_the_processes_of_a_killed_twin_experiment_end_with_it(quick: Path, tmp_path: Path) -> None:
    """Otherwise they would go on writing to a folder where the same command runs again."""
    places = [f"output={tmp_path / 'output'}", f"tracking.root={tmp_path / 'mlruns'}"]
    process = start([f"conf={quick}", *places])
    _, left = kill_when(process, lambda printed: any("check the" in line for line in printed))
    assert process.returncode == -signal.SIGKILL and not left
    assert not (tmp_path / "output" / "findings.json").exists()
