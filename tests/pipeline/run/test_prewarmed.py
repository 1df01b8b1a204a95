"""A prewarmed process runs its arguments, and nothing without arguments."""

from __future__ import annotations

import json
import subprocess
import sys


def run_prewarmed(done: str, *modules: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "dashred.pipeline.run.prewarmed", *modules]
    return subprocess.run(command, input=done, capture_output=True, text=True)


def test_it_runs_the_entry_point_on_the_words_from_stdin() -> None:
    words = json.dumps(["conf=nowhere", "a word with spaces and an 'apostrophe'"])
    done = run_prewarmed(words + "\n", "dashred.train", "json")
    assert done.returncode == 2
    direct = subprocess.run(
        [sys.executable, "-m", "dashred.train", *json.loads(words)], capture_output=True, text=True
    )
    assert (done.returncode, done.stdout, done.stderr) == (2, direct.stdout, direct.stderr)
    assert "nowhere" in done.stderr or "apostrophe" in done.stderr


def test_without_arguments_it_ends_quietly() -> None:
    ended = run_prewarmed("", "dashred.train")
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")
