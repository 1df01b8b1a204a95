"""What a program leaves behind in a session of its own ends with the process of dashred."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from dashred.physics.external.adapters.command.left_behind import (
    MARK,
    end_left_behind,
    marked_environment,
)
from tests.physics.external.adapters.command.test_command import is_running

pytestmark = pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="needs /proc")
# A process that runs a program, which starts a daemon and ends.
CALLER = """
import sys
from pathlib import Path
from dashred.physics.external.adapters.command.process import run_process
run_process([sys.executable, "-S", "-E", "-c", sys.argv[2]], Path(sys.argv[1]), 20.0)
"""
PROGRAM = """
import subprocess, sys
words = [sys.executable, "-S", "-E", "-c", "import time; time.sleep(60)"]
started = subprocess.Popen(words, start_new_session=True)
print(started.pid)
"""


def test_a_daemon_of_a_program_is_ended(tmp_path: Path) -> None:
    other = subprocess.Popen([sys.executable, "-S", "-E", "-c", "import time; time.sleep(60)"])
    words = [sys.executable, "-c", CALLER, str(tmp_path), PROGRAM]
    subprocess.run(words, check=True, timeout=50)
    assert not is_running(int((tmp_path / "stdout").read_text()))
    assert other.poll() is None
    other.kill()
    other.wait()


def test_a_program_of_another_process_of_the_same_number_lives() -> None:
    words = [sys.executable, "-S", "-E", "-c", "import time; time.sleep(60)"]
    others = [
        subprocess.Popen(words, env={**os.environ, MARK: mark})
        for mark in (str(os.getpid()), f"{os.getpid()}-0123456789abcdef")
    ]
    own = subprocess.Popen(words, env=marked_environment())
    end_left_behind()
    assert own.wait(20) == -signal.SIGKILL
    assert [other.poll() for other in others] == [None, None]
    for other in others:
        other.kill()
        other.wait()
