"""One isolated analysis: the files of its case in, the files of its findings out.

The files travel by value, so that the analysis can run on another machine. It sees the files that
it is given and nothing else; the truth of the case stays on the machine that draws and scores.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock

from dashred.core.errors import DONE
from dashred.core.job_control import last_line
from dashred.evaluation.isolation.worker import (
    Worker,
    WorkerLostError,
    isolated_copy,
    store_words,
    worker,
)

# In the words of an analysis these stand for the folders of its case and of its findings.
GIVEN, FOUND = "{given}", "{found}"
LOG = "log.txt"

_lock = Lock()
_copies: list[tempfile.TemporaryDirectory[str]] = []


@dataclass(frozen=True)
class Analysis:
    """A recording to analyse.

    Attributes:
        files: contents of the files that the analysis sees, by name.
        words: its arguments, with :data:`GIVEN` and :data:`FOUND` for its folders.
        limit: seconds after which it is ended.
    """

    files: Mapping[str, bytes]
    words: tuple[str, ...]
    limit: float


@dataclass(frozen=True)
class Answer:
    """What an analysis leaves.

    Attributes:
        seconds: CPU seconds of the analysis; its wall seconds if the process was ended.
        wall: wall seconds.
        problem: why there are no findings; None for an analysis that has ended well.
        log: what it has printed.
        files: contents of the files of its folder of findings, by relative path.
        lost: whether the process died or was ended.
    """

    seconds: float
    wall: float
    problem: str | None
    log: bytes
    files: Mapping[str, bytes] = field(default_factory=dict)
    lost: bool = False

    def write(self, findings: Path, log: Path) -> None:
        """Write the files of the findings and the log."""
        findings.mkdir(exist_ok=True)
        for name, content in self.files.items():
            path = findings / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        log.write_bytes(self.log)


def analyse(analysis: Analysis, started: Callable[[Worker], None] | None = None) -> Answer:
    """Run an analysis in a process of its own.

    Args:
        analysis: what to analyse.
        started: called with the process before it begins.
    """
    with tempfile.TemporaryDirectory(prefix="dashred-analysis-") as name:
        folder = Path(name)
        given, found, log = folder / "case", folder / "findings", folder / LOG
        given.mkdir()
        for file, content in analysis.files.items():
            (given / file).write_bytes(content)
        log.touch()
        copy = _package_copy()
        words = [
            *(w.replace(GIVEN, str(given)).replace(FOUND, str(found)) for w in analysis.words),
            *store_words(copy),
        ]
        began = time.perf_counter()
        try:
            with worker(copy) as current:
                if started is not None:
                    started(current)
                code, seconds = current.analyse(words, log, analysis.limit)
        except WorkerLostError as lost:
            wall = time.perf_counter() - began
            late = wall >= analysis.limit
            what = f"no answer within {analysis.limit:g} s" if late else f"the process died: {lost}"
            return Answer(wall, wall, what, log.read_bytes(), lost=True)
        wall = time.perf_counter() - began
        problem = None if code == DONE else last_line(log) or f"exit code {code}"
        return Answer(seconds, wall, problem, log.read_bytes(), _read_files(found))


def _package_copy() -> Path:
    """Return the isolated copy of this process, which all its analyses share."""
    with _lock:
        if not _copies:
            _copies.append(tempfile.TemporaryDirectory(prefix="dashred-worker-"))
            isolated_copy(Path(_copies[0].name))
        return Path(_copies[0].name)


def _read_files(folder: Path) -> dict[str, bytes]:
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}
