"""``system.simulator``: no code runs before the command line trusts it."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from dashred.config import Config, load_config
from dashred.core.errors import InputError
from dashred.physics.system import System

CODE = """\
import pathlib

pathlib.Path(__file__).with_name("ran").touch()


def step(state, t, dt, inputs, parameters):
    return {"x": state["x"] + dt * state["v"], "v": state["v"] - dt * parameters["k"] * state["x"]}


def run(start, times, inputs, parameters):
    dt = times[1] - times[0]
    after = step(start, times[0], dt, inputs, parameters)
    return {name: [start[name], after[name]] for name in start}


number = 3
"""
CONFIG = """\
system:
  title: Oscillator
  fields: {x: place, v: velocity}
  parameters: {k: 2.0}
  simulator: {function: my_steps.step}
  start: {x: 1, v: 0}
  integrator: {dt: 0.01}
"""
NAME = "my_steps.step"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "my_steps.py").write_text(CODE)
    (tmp_path / "mine.yaml").write_text(CONFIG)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "my_steps", raising=False)
    monkeypatch.setattr("dashred.physics.external.trust._trusted", set())
    return tmp_path


def load(folder: Path, *words: str) -> Config:
    own = (f"conf={folder / 'mine.yaml'}", "recording.path=swing.csv")
    return load_config([*own, *words], entry="train")


def test_a_trusted_function_steps_the_system(folder: Path) -> None:
    config = load(folder, f"trust={NAME}")
    assert not (folder / "ran").exists()
    program = System(config.system, config.where).program
    assert program is not None
    one = np.ones(1)
    found = program.step(np.array([[1.0, 0.5]]), 0 * one, 0.1 * one, {}, {"k": 2.0})
    np.testing.assert_allclose(found, [[1.05, 0.3]])


def test_no_line_of_a_function_runs_without_trust(folder: Path) -> None:
    for words in ((), ("trust=my_steps.run",), (f"trust={NAME}x",)):
        with pytest.raises(InputError, match=r"this system runs my_steps\.step") as error:
            load(folder, *words)
        assert f"add trust={NAME}" in str(error.value)
    assert not (folder / "ran").exists()


def test_a_process_that_was_not_told_opens_nothing(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = load(folder, f"trust={NAME}")
    monkeypatch.setattr("dashred.physics.external.trust._trusted", set())
    with pytest.raises(InputError, match="this system runs"):
        _ = System(config.system, config.where).program
    assert not (folder / "ran").exists()


REFUSED = {
    "system.simulator.function=step": "'step' is not a name in a module",
    "system.simulator.function=dashred.train.main": "is not a user's simulator",
    "system.simulator.run=my_steps.run": "simulator.function and system.simulator.run are both",
    "system.simulator.function=null": "system.simulator names no program",
    "system.snapshots=runs.nc": "system.simulator.function and system.snapshots are both given",
    "system.class=my_steps.number": "system.class and system.simulator.function are both given",
    "system.simulator.functoin=a.b": "unknown key system.simulator.functoin",
}


@pytest.mark.parametrize("word", REFUSED)
def test_what_does_not_go_with_a_simulator_is_refused(folder: Path, word: str) -> None:
    name = word.partition("=")[2] if "function=" in word else NAME
    with pytest.raises(InputError, match=REFUSED[word]):
        load(folder, word, f"trust={name}")
    assert not (folder / "ran").exists()


@pytest.mark.parametrize(
    ("name", "said"),
    {
        "my_steps.absent": "my_steps.absent cannot be imported: AttributeError",
        "no_such_module.step": "cannot be imported: ModuleNotFoundError",
        "my_steps.number": "my_steps.number is not a function",
    }.items(),
)
def test_a_function_that_is_not_there_is_refused(folder: Path, name: str, said: str) -> None:
    config = load(folder, f"system.simulator.function={name}", f"trust={name}")
    with pytest.raises(InputError, match=said):
        _ = System(config.system, config.where).program
