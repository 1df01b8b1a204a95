"""Run analyses in processes that cannot access a truth.

Each worker runs in a copy of the package without ``evaluation`` and without the twins. It gets a
recording in a folder with nothing else, and a seed. While it runs, the truth of its case is not on
disk.
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
PACKAGES = ("dashred", "datamodules", "callbacks")
# Time limit of an analysis in seconds.
LIMIT = 3600.0
# Environment variables that a worker inherits.
ENVIRONMENT = ("PATH", "HOME", "LANG", "TMPDIR", "MPLCONFIGDIR")


class WorkerLostError(Exception):
    """The process of a worker has ended unexpectedly."""


@dataclass(frozen=True, eq=False)
class Worker:
    """A process that analyses one recording after another."""

    process: subprocess.Popen[str]

    def analyse(self, words: Sequence[str], log: Path, limit: float) -> tuple[int, float]:
        """Return the exit code and the CPU seconds of one analysis.

        Raises:
            WorkerLostError: the process died or exceeded the time limit in seconds.
        """
        assert self.process.stdin is not None and self.process.stdout is not None
        watch = Timer(limit, self.process.kill)
        watch.start()
        try:
            print(json.dumps({"words": list(words), "log": str(log)}), file=self.process.stdin)
            self.process.stdin.flush()
            answer = json.loads(self.process.stdout.readline())
        except (BrokenPipeError, ValueError):
            raise WorkerLostError(f"exit code {self.process.poll()}") from None
        finally:
            watch.cancel()
        return int(answer["code"]), float(answer["cpu_seconds"])


def isolated_python(copy: Path) -> tuple[list[str], dict[str, str]]:
    """Return the command and environment of a Python that imports only from a copy.

    Without ``site``, an editable installation of the checkout is not found.
    """
    known = {name: os.environ[name] for name in ENVIRONMENT if name in os.environ}
    paths = dict.fromkeys((str(copy), get_path("purelib"), get_path("platlib")))
    environment = known | {"PYTHONPATH": os.pathsep.join(paths), "OMP_NUM_THREADS": "1"}
    return [sys.executable, "-S"], environment


def isolated_copy(to: Path) -> Path:
    """Copy the package without ``evaluation``, and the systems without their twins.

    The kernels that Numba has compiled are copied, too. It would compile them again for a minute.
    """
    for name in PACKAGES:
        ignored = shutil.ignore_patterns("evaluation", "*.pyc")
        shutil.copytree(CHECKOUT / name, to / name, ignore=ignored)
    (to / "conf").mkdir()
    for path in (CHECKOUT / "conf").glob("*.yaml"):
        shutil.copy(path, to / "conf")
    return to


def store_words(copy: Path) -> list[str]:
    """Return the arguments by which an analysis logs to a store in its isolated copy."""
    store = f"tracking.root={copy / 'mlruns'}"
    return [store, "tracking.experiment=analysis", "tracking.model=false"]


@contextmanager
def worker(copy: Path) -> Iterator[Worker]:
    """Start a worker in an isolated copy; terminate it at the end of the block."""
    command, environment = isolated_python(copy)
    process = subprocess.Popen(
        [*command, "-m", "dashred.pipeline.worker"],
        cwd=copy,
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        # In its own session, so that Ctrl-C reaches it only through this process.
        start_new_session=True,
    )
    try:
        yield Worker(process)
    finally:
        process.kill()
        # The worker may have died before it read its last input.
        with suppress(BrokenPipeError), process:
            pass
