"""A run that is killed at any point: the same command again gives the same findings."""

from __future__ import annotations

import json
import os
import signal
import sqlite3
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from queue import SimpleQueue

import pytest

from dashred.attempt import pointed_to
from tests.conftest import CHECKOUT, Ended, run_command

# What the run prints when a stage ends, or the file that it has begun to write.
PRINTED = (
    "check the resolution",
    "train SHRED",
    "assimilate",
    "grow the horizon",
    "weigh other causes",
    "train corrected",
)
WRITTEN = (".estimates.nc.*.partial", "findings.json", "evidence.png", "report.html")
WAIT_SECONDS = 300.0


def start(folder: Path, words: list[str]) -> subprocess.Popen[str]:
    places = [f"output={folder / 'output'}", f"tracking.root={folder / 'mlruns'}"]
    return subprocess.Popen(
        [sys.executable, "-u", "-m", "dashred.train", *words, *places],
        cwd=CHECKOUT,
        env=os.environ | {"NO_COLOR": "1", "COLUMNS": "200"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def kill_when(
    process: subprocess.Popen[str], reached: Callable[[list[str]], bool]
) -> tuple[list[str], bool]:
    """Kill a run that has got so far; returns what it has printed, and if any of it is left."""
    lines: SimpleQueue[str] = SimpleQueue()
    assert process.stdout is not None
    stdout = process.stdout

    def listen() -> None:
        for line in stdout:
            lines.put(line)

    listener = threading.Thread(target=listen, daemon=True)
    listener.start()
    watch = threading.Timer(WAIT_SECONDS, process.kill)
    watch.start()
    printed: list[str] = []
    try:
        while process.poll() is None and not reached(printed):
            while not lines.empty():
                printed.append(lines.get())
            threading.Event().wait(0.001)
    finally:
        watch.cancel()
        process.send_signal(signal.SIGKILL)
        process.wait()
    # Whatever it has started holds the pipe, too: it ends when the last of them has ended.
    listener.join(10.0)
    left = listener.is_alive()
    if not left:
        stdout.close()
    return printed, left


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
    run_id = pointed_to(tmp_path / "output")
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

    process = start(folder, words)
    printed, left = kill_when(process, reached)
    assert process.returncode == -signal.SIGKILL and not left, "".join(printed)
    assert not (output / "run.json").exists()


@pytest.mark.slow
def test_the_processes_of_a_killed_twin_experiment_end_with_it(quick: Path, tmp_path: Path) -> None:
    """Otherwise they would go on writing to a folder where the same command runs again."""
    process = start(tmp_path, [f"conf={quick}"])
    _, left = kill_when(process, lambda printed: any("check the" in line for line in printed))
    assert process.returncode == -signal.SIGKILL and not left
    assert not (tmp_path / "output" / "findings.json").exists()
