"""``system.simulator``: no code runs before the command line trusts it."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from dashred.config import Config, frozen_input, load_config
from dashred.core.errors import InputError
from dashred.physics.system import System
from dashred.pipeline.run.run_manifest import stored_arguments, write_manifest

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


COMMAND = 'simulator: {command: [./solver, --fast, "{input}", "{output}"], time_limit: 5}'


@pytest.mark.parametrize("name", ["./solver", "cases/solver", "solver"])
@pytest.mark.parametrize("kind", ["command", "fmu"])
def test_a_file_is_trusted_as_it_is_written_or_from_here(
    folder: Path, monkeypatch: pytest.MonkeyPatch, name: str, kind: str
) -> None:
    monkeypatch.chdir(folder)
    cases = folder / "cases"
    cases.mkdir()
    key = COMMAND if kind == "command" else "simulator: {fmu: solver}"
    (cases / "mine.yaml").write_text(CONFIG.replace("simulator: {function: my_steps.step}", key))
    for words in ((), ("trust=./other",), ("trust=other/solver",)):
        shown = "solver --fast {input} {output}, with" if kind == "command" else "solver, with"
        with pytest.raises(InputError, match=f"this system runs {cases}/{shown}"):
            load(cases, *words)
    config = load(cases, f"trust={name}")
    given = frozen_input(config)["system"]["simulator"]
    if kind == "command":
        assert given == {"command": ["solver", "--fast", "{input}", "{output}"]}
    else:
        assert given == {"fmu": "solver"}


@pytest.mark.parametrize("key", [COMMAND, "simulator: {fmu: a.fmu, variables: {x: b.x}}"])
def test_a_run_that_is_resumed_needs_trust_again(folder: Path, key: str) -> None:
    text = CONFIG.replace("simulator: {function: my_steps.step}", key)
    (folder / "mine.yaml").write_text(text)
    name = str(folder / ("solver" if key == COMMAND else "a.fmu"))
    config = load(folder, f"trust={name}")
    write_manifest(folder / "run", config, {})
    told = stored_arguments(folder / "run")
    assert told is not None
    with pytest.raises(InputError, match="this system runs"):
        load_config(told, entry="train")
    again = load_config([*told, f"trust={name}"], entry="train")
    assert frozen_input(again) == frozen_input(config)
    assert again.system.simulator == config.system.simulator


KEYS = {
    "template=a.j2": "template is for a command",
    "interface=co-simulation": "interface is for an FMU",
    "variables={x: a}": "variables is for an FMU",
    "time_limit=0": "time_limit must be above 0",
}


@pytest.mark.parametrize("word", KEYS)
def test_a_key_of_another_kind_of_program_is_refused(folder: Path, word: str) -> None:
    with pytest.raises(InputError, match=KEYS[word]):
        load(folder, f"system.simulator.{word}", f"trust={NAME}")


TEXTS = {
    ("v: velocity}", "dt: velocity}"): "'dt' is a name of the files of a command",
    ("title:", "axes: {y: {length: 1, points: 8, ends: {left: fixed, right: fixed}}}\n  title:"): (
        "a program cannot have an axis with a condition for each side"
    ),
    ('[./solver, --fast, "{input}", "{output}"]', "[]"): "command has no words",
}


@pytest.mark.parametrize("change", TEXTS, ids=TEXTS.values())
def test_what_a_command_cannot_have_is_refused(folder: Path, change: tuple[str, str]) -> None:
    text = CONFIG.replace("simulator: {function: my_steps.step}", COMMAND).replace(*change)
    (folder / "mine.yaml").write_text(
        text.replace("{x: 1, v: 0}", "{x: 1, dt: 0}") if "dt: v" in text else text
    )
    with pytest.raises(InputError, match=TEXTS[change]):
        load(folder, "trust=./solver")


def test_an_fmu_has_no_axes(folder: Path) -> None:
    text = CONFIG.replace("function: my_steps.step", "fmu: a.fmu")
    text = text.replace("title:", "axes: {y: {length: 1, points: 8}}\n  title:")
    (folder / "mine.yaml").write_text(text)
    with pytest.raises(InputError, match="it has no axes"):
        load(folder, "trust=a.fmu")


def test_python_gives_trust_by_an_argument(folder: Path) -> None:
    from dashred import Problem

    (folder / "swing.csv").write_text("time,x\n" + "".join(f"{i * 0.1},{i}\n" for i in range(9)))
    path, recording = str(folder / "mine.yaml"), str(folder / "swing.csv")
    with pytest.raises(InputError, match="this system runs"):
        Problem.from_yaml(path, recording=recording).check()
    assert not (folder / "ran").exists()
