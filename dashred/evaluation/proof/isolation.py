"""Analysts that have no way to the seal.

Each is a process of its own, in a copy of the package without the recorder, the scorer, the draw
and the twins. It is handed a recording in a folder that holds nothing else, a seed that says
nothing, and no name. While it works, the truth of its case is on no disk.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from sysconfig import get_path
from threading import Timer

CHECKOUT = Path(__file__).resolve().parents[3]
NEEDED = ("dashred", "datamodules", "callbacks", "conf")
# Whatever draws, records, opens or scores.
CONCEALED = (
    *("twins", "proof", "benchmark", "comparison", "__pycache__"),
    *("record.py", "recorder.py", "sealing.py", "twin_file.py", "twin_experiment.py"),
    *("score.py", "scoring.py", "cause_scoring.py", "window_kinds.py", "bench.py", "prove.py"),
    *("compare.py", "publish.py", "standby.py", "faulty.py", "resume.py", "kept_seal.py"),
)
# An analysis that takes so many seconds will not end.
LIMIT = 3600.0
# Of our own surroundings an analyst needs no more.
SURROUNDINGS = ("PATH", "HOME", "LANG", "TMPDIR", "MPLCONFIGDIR")


class AnalystLostError(Exception):
    """An analyst's process has ended, though nobody told it to."""


@dataclass(frozen=True, eq=False)
class Analyst:
    """A process that analyses one recording after another."""

    process: subprocess.Popen[str]

    def analyse(self, words: Sequence[str], log: Path, limit: float) -> tuple[int, float]:
        """Return the exit code of one analysis, and the CPU seconds that it took.

        Raises:
            AnalystLostError: the process died of it, or took longer than so many seconds.
        """
        assert self.process.stdin is not None and self.process.stdout is not None
        watch = Timer(limit, self.process.kill)
        watch.start()
        try:
            print(json.dumps({"words": list(words), "log": str(log)}), file=self.process.stdin)
            self.process.stdin.flush()
            answer = json.loads(self.process.stdout.readline())
        except (BrokenPipeError, ValueError):
            raise AnalystLostError(f"exit code {self.process.poll()}") from None
        finally:
            watch.cancel()
        return int(answer["code"]), float(answer["cpu_seconds"])


def python(copy: Path) -> tuple[list[str], dict[str, str]]:
    """Return the command and the surroundings in which Python sees a copy, and no checkout.

    Without ``site`` nothing of an editable installation, which leads to the checkout, is in reach.
    """
    known = {name: os.environ[name] for name in SURROUNDINGS if name in os.environ}
    paths = dict.fromkeys((str(copy), get_path("purelib"), get_path("platlib")))
    surroundings = known | {"PYTHONPATH": os.pathsep.join(paths), "OMP_NUM_THREADS": "1"}
    return [sys.executable, "-S"], surroundings


def bare_copy(to: Path) -> Path:
    """Copy what an analysis needs, and nothing that knows of truths."""
    for name in NEEDED:
        shutil.copytree(CHECKOUT / name, to / name, ignore=shutil.ignore_patterns(*CONCEALED))
    return to


@contextmanager
def analyst(copy: Path) -> Iterator[Analyst]:
    """Start an analyst in a bare copy; it ends with the block."""
    command, surroundings = python(copy)
    process = subprocess.Popen(
        [*command, "-m", "dashred.pipeline.worker"],
        cwd=copy,
        env=surroundings,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        # Its own group: Ctrl-C reaches it through us alone.
        start_new_session=True,
    )
    try:
        yield Analyst(process)
    finally:
        process.kill()
        # Words that it did not live to read are lost with it.
        with suppress(BrokenPipeError), process:
            pass
