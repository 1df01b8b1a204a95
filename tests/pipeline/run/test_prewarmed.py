"""A process that stands by: it runs what it is told, and nothing if it is told nothing."""

from __future__ import annotations

import json
import subprocess
import sys


def stand_by(told: str, *modules: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "dashred.pipeline.run.prewarmed", *modules]
    return subprocess.run(command, input=told, capture_output=True, text=True)


def test_it_runs_the_entry_point_on_the_words_from_stdin() -> None:
    words = json.dumps(["conf=nowhere", "a word with spaces and an 'apostrophe'"])
    told = stand_by(words + "\n", "dashred.train", "json")
    assert told.returncode == 2
    direct = subprocess.run(
        [sys.executable, "-m", "dashred.train", *json.loads(words)], capture_output=True, text=True
    )
    assert (told.returncode, told.stdout, told.stderr) == (2, direct.stdout, direct.stderr)
    assert "nowhere" in told.stderr or "apostrophe" in told.stderr


def test_without_a_word_it_ends_quietly() -> None:
    ended = stand_by("", "dashred.train")
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")
