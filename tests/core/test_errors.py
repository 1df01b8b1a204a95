"""Messages of input errors, and exit codes of entry points."""

from __future__ import annotations

import pickle
import subprocess
import sys

import pytest

from dashred.core.errors import InputError, run_entry

FULL = InputError("unknown key shred.lag", where="my.yaml:3", hint="did you mean shred.lags?")


def _raise(error: BaseException) -> int:
    raise error


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (FULL, "my.yaml:3: unknown key shred.lag\n  did you mean shred.lags?"),
        (InputError("no recording", where="command line"), "command line: no recording"),
        (InputError("no recording", hint="give one"), "no recording\n  give one"),
    ],
)
def test_message_reads_where_what_hint(error: InputError, text: str) -> None:
    assert str(error) == text


def test_error_survives_a_process_boundary() -> None:
    copy = pickle.loads(pickle.dumps(FULL))
    assert (copy.what, copy.where, copy.hint) == (FULL.what, FULL.where, FULL.hint)
    assert str(copy) == str(FULL)


def test_wrong_input_ends_with_2_on_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_entry(lambda _: _raise(FULL)) == 2
    out, err = capsys.readouterr()
    assert (out, err) == ("", f"error: {FULL}\n")


def test_interrupt_ends_with_130() -> None:
    assert run_entry(lambda _: _raise(KeyboardInterrupt())) == 130


def test_main_gets_the_arguments_and_returns_the_code(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["train", "conf=rde", "seed=1"])
    assert run_entry(len) == 2


def test_our_own_failures_keep_their_traceback_and_end_with_1() -> None:
    program = "import sys, dashred.core.errors as e; sys.exit(e.run_entry(lambda words: 1 // 0))"
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert ended.returncode == 1
    assert "ZeroDivisionError" in ended.stderr


@pytest.mark.parametrize("words", ["--help", "conf=absent"])
def test_nothing_is_printed_when_stdout_is_closed(words: str) -> None:
    command = f"{sys.executable} -m dashred.train {words}"
    shell = ["sh", "-c", f"({command} | true) 2>&1"]
    ended = subprocess.run(shell, capture_output=True, text=True)
    assert "Traceback" not in ended.stdout and "BrokenPipe" not in ended.stdout
