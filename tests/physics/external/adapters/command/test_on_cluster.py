"""A command whose calls run on a Dask cluster."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest

from dashred.core.cluster.calls import ClusterCalls, cluster_in_use, use_cluster
from dashred.core.cluster.word import Cluster
from dashred.core.errors import InputError
from dashred.physics.external.adapters.command.command import CommandWords, open_command
from dashred.physics.external.adapters.command.layout import Layout
from dashred.physics.external.adapters.command.left_behind import end_left_behind, marks
from dashred.physics.external.adapters.command.on_cluster import ClusterCommandAdapter
from dashred.physics.external.stepped import SteppedProgram
from dashred.physics.grids.grid import Axis, Grid
from tests.physics.external.adapters.command.test_command import is_running

pytest.importorskip("distributed")

GRID = Grid((Axis("x", 1.0, 4),))
LAYOUT = Layout(("u",), ("x",), {"x": ("x", np.arange(4) / 4)}, {})
TEMPLATE = "{{ dt }}\n{% for i in range(x|length) %}\n{{ u[i] }}\n{% endfor %}\n"
# du/dt = -u; the process that made a result is noted beside it.
SOLVER = """\
import math, os, sys
source, target = sys.argv[1:]
dt, *u = [float(line) for line in open(source)]
{extra}
with open(target, "w") as file:
    print("# u", file=file)
    for value in u:
        print(repr(value * math.exp(-dt)), file=file)
"""


def words_of(folder: Path, extra: str = "") -> CommandWords:
    (folder / "solver.py").write_text(SOLVER.format(extra=extra))
    (folder / "input.j2").write_text(TEMPLATE)
    solver = [sys.executable, "-S", "-E", str(folder / "solver.py"), "{input}", "{output}"]
    return CommandWords(tuple(solver), str(folder / "input.j2"), 30.0, LAYOUT, "mine.yaml:3")


def program_of(words: CommandWords) -> SteppedProgram:
    return SteppedProgram(ClusterCommandAdapter(words, open_command(words)), GRID, keep=False)


def step(program: SteppedProgram, states: np.ndarray) -> np.ndarray:
    return program.step(states, np.zeros(len(states)), np.full(len(states), 0.1), {}, {})


def test_without_a_cluster_it_runs_here(tmp_path: Path) -> None:
    assert cluster_in_use() is None
    program = program_of(words_of(tmp_path))
    np.testing.assert_allclose(step(program, np.ones((2, 1, 4))), np.exp(-0.1), rtol=1e-12)


@pytest.fixture(scope="module")
def two_workers() -> Iterator[None]:
    with use_cluster(Cluster("local", 2), marks()):
        yield


def test_workers_return_what_this_machine_returns(tmp_path: Path, two_workers: None) -> None:
    parents = "open(sys.argv[0] + str(os.getppid()), 'w')"
    program = program_of(words_of(tmp_path, parents))
    states = 1 + np.random.default_rng(0).random((8, 1, 4))
    found = step(program, states)
    callers = {int(path.name.removeprefix("solver.py")) for path in tmp_path.glob("solver.py?*")}
    assert len(callers) == 2
    assert os.getpid() not in callers
    own = SteppedProgram(open_command(words_of(tmp_path)), GRID, keep=False)
    np.testing.assert_array_equal(found, step(own, states))
    np.testing.assert_allclose(found, states * np.exp(-0.1), rtol=1e-12)
    assert program.seconds_of(8) == pytest.approx(program.seconds * 4)


def test_a_state_that_fails_is_lost_alone(tmp_path: Path, two_workers: None) -> None:
    program = program_of(words_of(tmp_path, "if u[0] > 5: sys.exit('too large')"))
    states = np.ones((4, 1, 4))
    states[2] = 6.0
    found = step(program, states)
    assert np.isfinite(found[[0, 1, 3]]).all()
    assert np.isnan(found[2]).all()
    assert program.failure is not None
    assert "too large" in program.failure


def test_a_program_that_ends_its_worker_is_a_failure(tmp_path: Path, two_workers: None) -> None:
    kill = "if u[0] > 5: os.kill(os.getppid(), 9)"
    program = program_of(words_of(tmp_path, kill))
    states = np.ones((3, 1, 4))
    states[1] = 6.0
    found = step(program, states)
    assert np.isfinite(found[[0, 2]]).all()
    assert np.isnan(found[1]).all()
    assert program.failure is not None
    assert "ends its worker" in program.failure


class _Workers:
    """A client whose only worker answers as it is told."""

    def __init__(self, answer: str) -> None:
        self.answer = answer

    def run(self, function: Callable[[], Any]) -> dict[str, Any]:
        return {"tcp://10.0.0.2:4000": self.answer}


@pytest.mark.parametrize(("answer", "what"), [("", "cannot run"), ("0" * 64, "another version")])
def test_a_worker_without_the_program_is_refused(tmp_path, monkeypatch, answer, what) -> None:
    calls = ClusterCalls(_Workers(answer), 1)  # type: ignore[arg-type]
    module = "dashred.physics.external.adapters.command.on_cluster.cluster_in_use"
    monkeypatch.setattr(module, lambda: calls)
    program = program_of(words_of(tmp_path))
    with pytest.raises(InputError, match=rf"tcp://10.0.0.2:4000 .*{what}.* solver.py"):
        step(program, np.ones((1, 1, 4)))


def test_a_program_of_a_worker_ends_with_this_process(tmp_path: Path) -> None:
    """A worker that is killed leaves its program behind, which is known by the mark."""
    sleep = "open(sys.argv[0] + str(os.getpid()), 'w'); import time; time.sleep(60)"
    words = words_of(tmp_path, "if u[0] > 5: " + sleep)

    def call() -> None:
        # The cluster ends before the program does.
        with suppress(Exception):
            step(program, np.full((1, 1, 4), 6.0))

    with use_cluster(Cluster("local", 1), marks()):
        program = program_of(words)
        step(program, np.ones((1, 1, 4)))
        Thread(target=call, daemon=True).start()
        end = time.monotonic() + 20
        while not (started := list(tmp_path.glob("solver.py?*"))) and time.monotonic() < end:
            time.sleep(0.1)
    pid = int(started[0].name.removeprefix("solver.py"))
    end_left_behind()
    time.sleep(0.2)
    assert not is_running(pid)
