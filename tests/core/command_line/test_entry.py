"""Exit codes and output of commands, and garbage collection at imports and at exit."""

from __future__ import annotations

import gc
import subprocess
import sys

import pytest

from dashred.core.command_line.entry import fast_imports, run_entry
from dashred.core.errors import InputError

WRONG = InputError("unknown key shred.lag", where="my.yaml:3", hint="did you mean shred.lags?")


def _raise(error: BaseException) -> int:
    raise error


def test_wrong_input_ends_with_2_on_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_entry(lambda _: _raise(WRONG)) == 2
    out, err = capsys.readouterr()
    assert (out, err) == ("", f"error: {WRONG}\n")


def test_interrupt_ends_with_130() -> None:
    assert run_entry(lambda _: _raise(KeyboardInterrupt())) == 130


def test_main_gets_the_arguments_and_returns_the_code(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["train", "conf=rde", "seed=1"])
    assert run_entry(len) == 2


def test_our_own_failures_keep_their_traceback_and_end_with_1() -> None:
    program = (
        "import sys; from dashred.core.command_line.entry import run_entry\n"
        "sys.exit(run_entry(lambda words: 1 // 0))"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert ended.returncode == 1
    assert "ZeroDivisionError" in ended.stderr


@pytest.mark.parametrize("words", ["--help", "conf=absent"])
def test_nothing_is_printed_when_stdout_is_closed(words: str) -> None:
    command = f"{sys.executable} -m dashred.train {words}"
    shell = ["sh", "-c", f"({command} | true) 2>&1"]
    ended = subprocess.run(shell, capture_output=True, text=True)
    assert "Traceback" not in ended.stdout and "BrokenPipe" not in ended.stdout


def test_the_end_of_a_command_does_not_search_for_unused_objects() -> None:
    # Exit handlers run in reverse order, so that the first one sees what is left to search.
    program = (
        "import atexit, gc, sys\n"
        "from dashred.core.command_line.entry import run_entry\n"
        "atexit.register(lambda: print(len(gc.get_objects())))\n"
        "sys.exit(run_entry(lambda words: 0))"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert ended.returncode == 0
    assert int(ended.stdout) < 100


def test_objects_of_imports_are_left_out_of_the_search() -> None:
    program = (
        "import gc; from dashred.core.command_line.entry import fast_imports\n"
        "with fast_imports():\n"
        "    pass\n"
        "without = gc.get_freeze_count()\n"
        "with fast_imports():\n"
        "    import wave\n"
        "    is_off = not gc.isenabled()\n"
        "print(without, is_off, gc.get_freeze_count() > 0, gc.isenabled())"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert ended.stdout.split() == ["0", "True", "True", "True"]


def test_a_collector_that_was_off_stays_off() -> None:
    gc.disable()
    try:
        with fast_imports():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()
