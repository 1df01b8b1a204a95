"""``dashred COMMAND``: one table of commands, each with its usage text."""

from __future__ import annotations

import subprocess
import sys
import time
from importlib import import_module

import pytest

from dashred.__main__ import COMMANDS, main, usage
from dashred.core.errors import InputError
from tests.conftest import CHECKOUT


def dashred(*words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "dashred", *words]
    return subprocess.run(command, cwd=CHECKOUT, capture_output=True, text=True)


def test_without_a_command_all_are_listed() -> None:
    ended = dashred()
    assert ended.returncode == 2 and ended.stdout == usage()
    ended = dashred("--help")
    assert ended.returncode == 0 and ended.stdout == usage()
    assert all(f"\n  {name} " in usage() for name in COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_says_how_it_is_used(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([name, "--help"])
    assert ended.value.code == 0
    out = capsys.readouterr().out
    assert out.startswith(f"usage: dashred {name} ")
    assert import_module(COMMANDS[name].module).__doc__


@pytest.mark.parametrize(
    ("word", "hint"),
    [
        ("trian", "did you mean train?"),
        ("conf=rde", "dashred train conf=rde"),
        ("--seed", "one of: init, check, train"),
    ],
)
def test_an_unknown_command_is_refused_with_the_nearest(word: str, hint: str) -> None:
    with pytest.raises(InputError, match="there is no command") as caught:
        main([word])
    assert caught.value.hint and hint in caught.value.hint
    assert dashred("trian").returncode == 2


def test_the_version_is_that_of_the_package(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.count(".") == 2


@pytest.mark.parametrize(
    ("words", "limit"),
    [(["--help"], 1.0), (["train", "--help"], 2.0), (["prove", "case=1"], 2.0)],
)
def test_an_answer_takes_no_time(words: list[str], limit: float) -> None:
    """The best of several: other work on this machine is not what is measured."""
    seconds = []
    for _ in range(5):
        began = time.perf_counter()
        dashred(*words)
        seconds.append(time.perf_counter() - began)
        if seconds[-1] < limit:
            break
    assert min(seconds) < limit
