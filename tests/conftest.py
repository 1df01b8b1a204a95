"""Fixtures of all tests: one thread per test, fixed seeds, and a quick twin experiment."""

from __future__ import annotations

import io
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import pytest
import torch
from hypothesis import settings

from dashred.core.cluster.calls import ClusterCalls, open_calls
from dashred.core.cluster.word import Cluster
from dashred.core.mlflow.store import open_store

torch.set_num_threads(1)
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")

CHECKOUT = Path(__file__).resolve().parents[1]

QUICK = """\
system:
  title: Burgers
  axes: {x: {length: 2*pi, points: 32}}
  fields: {u: velocity}
  parameters: {nu: 0.2}
  equations: {u: "-d(u**2/2, x) + nu*lap(u)"}
  start: {u: 1 + 0.5*sin(x)}
  spread: {u: 10%, length: 1.0}
  integrator: {dt: 0.05}
library: {u: [u, u**2, u**3, "d(u, x)", "d(u, x, 2)"]}
recording: {twin: a, sensors: 4, noise: 0.02, duration: 4, every: 0.1}
splits: {sensors: {validate: 1, test: 1, extra: 1}}
simulation: {members: 24, held_out: 6, terms: 1}
shred: {lags: 5, latent: 8, decoder: [16], modes: 8, epochs: 2, steps: 4, batch: 8}
assimilation: {epochs: 2, width: 8}
latent_sindy: {steps: [1, 2], bootstraps: 3, begins: 3}
threads: 1
tracking: {model: false}
"""

TWINS = """\
a:
  terms: [{equation: u, term: u, coefficient: -0.1}]
b:
  terms: [{equation: u, term: u**3, coefficient: -0.1}]
"null":
  terms: []
"""


@dataclass(frozen=True)
class Ended:
    """The result of a command."""

    code: int
    out: str
    err: str
    output: Path
    root: Path

    def read(self, name: str) -> bytes:
        """Return the bytes of a file in the output folder."""
        return (self.output / name).read_bytes()


Run = Callable[..., Ended]


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out the tests that start servers, unless ``-m`` asks for them."""
    if "servers" in config.option.markexpr:
        return
    left_out = [item for item in items if item.get_closest_marker("servers")]
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if item not in left_out]


@pytest.fixture(scope="session", autouse=True)
def own_state(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Put the user's state folder among the files of the tests."""
    folder = tmp_path_factory.mktemp("state")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(folder))
        yield folder


@pytest.fixture(scope="session")
def empty_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The database of an empty MLflow store: creating its tables takes seconds."""
    root = tmp_path_factory.mktemp("store")
    open_store(str(root), "empty")
    return root / "mlflow.db"


def copy_store(empty_store: Path, root: Path) -> None:
    """Put an empty store into a folder, unless it has one."""
    if not root.exists():
        root.mkdir(parents=True)
        shutil.copy(empty_store, root)


@pytest.fixture(scope="session")
def two_workers() -> Iterator[ClusterCalls]:
    """Calls on two workers of this machine, for tests that put them into use."""
    pytest.importorskip("distributed")
    with open_calls(Cluster("local", 2), {}) as calls:
        yield calls


@pytest.fixture(scope="session")
def quick(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A system of 32 points with its twins; a complete run takes seconds."""
    folder = tmp_path_factory.mktemp("systems")
    (folder / "twins").mkdir()
    (folder / "twins" / "quick.yaml").write_text(TWINS)
    (folder / "quick.yaml").write_text(QUICK)
    return folder / "quick.yaml"


def run_command(folder: Path, *words: str, cwd: Path = CHECKOUT) -> Ended:
    """Run ``python -m dashred.train`` as a user would, with output and store in ``folder``."""
    output, root = folder / "output", folder / "mlruns"
    places = [f"output={output}", f"tracking.root={root}"]
    ended = subprocess.run(
        [sys.executable, "-m", "dashred.train", *words, *places],
        cwd=cwd,
        env=os.environ | {"NO_COLOR": "1", "COLUMNS": "200"},
        capture_output=True,
        text=True,
    )
    return Ended(ended.returncode, ended.stdout, ended.stderr, output, root)


@pytest.fixture(scope="session")
def twin_run(quick: Path, tmp_path_factory: pytest.TempPathFactory) -> Ended:
    """The twin experiment on twin a, in three real processes."""
    ended = run_command(tmp_path_factory.mktemp("twin"), f"conf={quick}")
    assert ended.code == 0, ended.err
    return ended


class InProcess:
    """A stand-in for ``subprocess.Popen`` that runs an entry point in this process."""

    started: ClassVar[list[list[str]]]
    monkeypatch: ClassVar[pytest.MonkeyPatch]
    code: int

    def __init__(self, command: list[str], **_: object) -> None:
        """Store the command."""
        assert command[1:3] == ["-m", "dashred.pipeline.run.prewarmed"]
        self.module = command[3]
        self.stdin = Told(self)

    def run(self, words: list[str]) -> None:
        """Run the entry point."""
        self.started.append([self.module, *words])
        self.code = _entry(self.monkeypatch, self.module, words)

    def wait(self) -> int:
        """Return the exit code."""
        return self.code

    def terminate(self) -> None:
        """Do nothing: the command has ended or was never started."""
        self.code = getattr(self, "code", 0)


class Told(io.StringIO):
    """The stdin of a waiting process."""

    def __init__(self, process: InProcess) -> None:
        """Store the reader."""
        super().__init__()
        self.process = process

    def close(self) -> None:
        """Pass the written text to the reader."""
        words = json.loads(self.getvalue())
        super().close()
        self.process.run(words)


def _entry(monkeypatch: pytest.MonkeyPatch, module: str, words: list[str]) -> int:
    from importlib import import_module

    from dashred.core.command_line.entry import run_entry

    with monkeypatch.context() as patch:
        patch.setattr(sys, "argv", [module, *words])
        return run_entry(import_module(module).main)


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch) -> type[InProcess]:
    """Run the processes of a twin experiment in this process."""

    class Here(InProcess):
        started: ClassVar[list[list[str]]] = []

    Here.monkeypatch = monkeypatch
    monkeypatch.setattr(
        "dashred.pipeline.run.processes.subprocess",
        SimpleNamespace(Popen=Here, PIPE=None),
    )
    return Here


@pytest.fixture
def processes(stand_in: type[InProcess]) -> list[list[str]]:
    """Run the processes of a twin experiment in this process, and record their arguments."""
    return stand_in.started


@pytest.fixture
def train(
    processes: list[list[str]],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    empty_store: Path,
    capfd: pytest.CaptureFixture[str],
) -> Run:
    """``train(*words)``: run the command in this process, by default without figures."""

    def run(*words: str, folder: Path = tmp_path, figures: bool = False) -> Ended:
        output, root = folder / "output", folder / "mlruns"
        copy_store(empty_store, root)
        if not figures:
            monkeypatch.setattr("dashred.pipeline.outputs.report.report", lambda *_: [])
            monkeypatch.setattr("dashred.evaluation.twins.truth_figures.draw_truth", lambda *_: [])
        places = [f"output={output}", f"tracking.root={root}"]
        try:
            code = _entry(monkeypatch, "dashred.train", [*words, *places])
        finally:
            torch.use_deterministic_algorithms(False)
        out, err = capfd.readouterr()
        return Ended(code, out, err, output, root)

    return run
