"""``system.class``: trust, and equivalence to declared equations."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from dashred.config import Config, frozen_input, load_config
from dashred.core.errors import InputError
from dashred.pipeline.run.run_manifest import stored_arguments, write_manifest
from tests.conftest import CHECKOUT
from tests.documents import snippets

PENDULUM = """\
import pathlib

import torch

pathlib.Path(__file__).with_name("ran").touch()


class Pendulum:
    def tendency(self, fields, t, parameters, space):
        p = parameters
        stiffness = p["a1"] * p["g"] * p["m1"] / (p["m1"] * p["a1"] ** 2 + p["I1"])
        return {"theta": fields["omega"], "omega": -stiffness * torch.sin(fields["theta"])}


class Broken:
    def tendency(self, fields, t, parameters, space):
        return {"theta": fields["speed"]}


class Short:
    def tendency(self, fields, t, parameters, space):
        return {"theta": fields["omega"]}


class Idle:
    pass
"""
NAME = "my_pendulum.Pendulum"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a class and its configuration: the bundled pendulum without equations."""
    (tmp_path / "my_pendulum.py").write_text(PENDULUM)
    bundled = (Path(__file__).parents[2] / "conf" / "pendulum.yaml").read_text()
    lines = bundled.splitlines()
    start = lines.index("  equations:")
    lines[start : start + 3] = [f"  class: {NAME}"]
    text = "\n".join(line for line in lines if not line.startswith("recording:"))
    (tmp_path / "mine.yaml").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "my_pendulum", raising=False)
    return tmp_path


def load(folder: Path, *words: str) -> Config:
    own = (f"conf={folder / 'mine.yaml'}", "recording.path=swing.csv")
    return load_config([*own, *words], entry="train")


def test_a_class_has_the_equations_of_its_declared_twin(folder: Path) -> None:
    """The same equations give the same findings, including the law."""
    from dashred.physics.system import System

    mine = load(folder, f"trust={NAME}")
    bundled = load_config(["conf=pendulum", "recording.path=swing.csv"], entry="train")
    ours, theirs = (System(config.system, config.where) for config in (mine, bundled))
    assert ours.equations == theirs.equations
    assert ours.resolved == theirs.resolved
    assert ours.method == theirs.method and ours.dt == theirs.dt
    told = frozen_input(mine)["system"]
    assert told["class"] == NAME and "class" not in frozen_input(bundled)["system"]


def test_a_parameter_of_a_class_may_be_uncertain(folder: Path) -> None:
    spread = ("system.parameters.a1.spread=0.01", f"trust={NAME}")
    assert load(folder, *spread).system.parameter_spread == {"a1": 0.01}


def test_no_line_of_a_class_runs_without_trust(folder: Path) -> None:
    for words in ((), ("trust=my_pendulum.Idle",)):
        with pytest.raises(InputError, match=r"runs my_pendulum\.Pendulum") as error:
            load(folder, *words)
        assert f"add trust={NAME}" in str(error.value)
    assert not (folder / "ran").exists()
    load(folder, f"trust={NAME}")
    assert (folder / "ran").exists()


def test_a_command_finds_it_in_the_folder_that_the_user_is_in(folder: Path) -> None:
    words = ["conf=mine.yaml", "recording.path=none.csv", f"trust={NAME}"]
    subprocess.run(
        [sys.executable, "-m", "dashred", "check", *words],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(CHECKOUT)},
        capture_output=True,
    )
    assert (folder / "ran").exists()


def test_what_has_begun_goes_on_with_the_users_word_alone(folder: Path) -> None:
    named = ("system.class=my_pendulum.Pendulum", f"trust={NAME}")
    for words in (named, named[1:]):
        config = load(folder, *words)
        write_manifest(folder, config, {})
        told = stored_arguments(folder)
        assert told is not None and not any(word.startswith("trust=") for word in told)
        with pytest.raises(InputError, match="runs my_pendulum"):
            load_config(told, entry="train")
        again = load_config([*told, f"trust={NAME}"], entry="train")
        assert frozen_input(again) == frozen_input(config)


def test_a_file_cannot_give_trust(folder: Path) -> None:
    path = folder / "mine.yaml"
    path.write_text(path.read_text() + f"\ntrust: {NAME}\n")
    with pytest.raises(InputError, match="unknown key trust"):
        load(folder)
    assert not (folder / "ran").exists()


REFUSED = {
    "my_pendulum.Broken": "my_pendulum.Broken fails: KeyError: 'speed' .*my_pendulum.py:17",
    "my_pendulum.Short": "tendency returns theta, not theta, omega by name",
    "my_pendulum.Idle": "has no method tendency",
    "my_pendulum.Absent": "my_pendulum.Absent fails: AttributeError",
    "no_such_module.Pendulum": "ModuleNotFoundError",
    "Pendulum": "is not a name in a module",
    "dashred.evaluation.twins.sealing.Truth": "is not a user's simulator",
    "os.path/../x": "is not a name in a module",
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_class_that_cannot_be_used_is_refused(folder: Path, name: str) -> None:
    with pytest.raises(InputError, match=REFUSED[name]):
        load(folder, f"system.class={name}", f"trust={name}")


WORDS = {
    "system.equations.theta=omega": "system.class and system.equations are both given",
    "system.snapshots=runs.nc": "system.class and system.snapshots are both given",
    "recording.twin=a": "a twin needs declared equations",
    "trust=again.Again": "trust= is given twice",
}


@pytest.mark.parametrize("word", WORDS)
def test_what_does_not_go_with_a_class_is_refused(folder: Path, word: str) -> None:
    with pytest.raises(InputError, match=WORDS[word]):
        own = [f"conf={folder / 'mine.yaml'}", f"trust={NAME}", word]
        path = [] if "twin" in word else ["recording.path=swing.csv"]
        load_config([*own, *path], entry="train")
    assert not (folder / "ran").exists()


def test_trust_without_a_class_is_refused() -> None:
    with pytest.raises(InputError, match="the system names no class"):
        load_config(["conf=pendulum", "trust=os.path"], entry="train")


def test_the_documents_example_is_taken_as_it_is_printed(tmp_path, monkeypatch) -> None:
    from dashred.physics.system import System

    page = Path(__file__).parents[2] / "docs" / "black-box.md"
    code, text = snippets(page, "python")[-1], snippets(page, "yaml")[-1]
    (tmp_path / "mypkg.py").write_text(code)
    (tmp_path / "mine.yaml").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "mypkg", raising=False)
    config = load(tmp_path, "trust=mypkg.Pendulum")
    system = System(config.system, config.where)
    assert system.title == "Pendulum" and system.units["theta"] == "rad"
    assert set(system.equations) == {"theta", "omega"}
