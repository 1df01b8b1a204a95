"""Analyse one recording after another: ``python -m dashred.pipeline.worker``.

All analyses share the imports and the compiled kernels. Each line of stdin is a JSON object with
the arguments of one analysis and its log file: ``{"words": [...], "log": FILE}``. The worker
answers it with a JSON object on stdout: ``{"code": 0, "cpu_seconds": 61.2}``. At the end of stdin
it exits at once, also from an analysis: nobody is left who waits for the answer.
"""

from __future__ import annotations

import json
import os
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from queue import SimpleQueue
from threading import Thread
from typing import NoReturn

from dashred.core.command_line.entry import run_entry
from dashred.core.errors import DONE, OUR_FAILURE, WRONG_INPUT, InputError


def main(argv: list[str]) -> NoReturn:
    """Answer every line of stdin."""
    with os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8") as answers:
        lines: SimpleQueue[str] = SimpleQueue()
        Thread(target=_read, args=(lines,), daemon=True).start()
        while True:
            request = json.loads(lines.get())
            started = time.process_time()
            with _print_to(request["log"]):
                code = _analyse(request["words"])
            spent = round(time.process_time() - started, 2)
            print(json.dumps({"code": code, "cpu_seconds": spent}), file=answers, flush=True)


def _read(lines: SimpleQueue[str]) -> None:
    """Pass on the lines of stdin; end the process with the last one."""
    for line in sys.stdin:
        lines.put(line)
    os._exit(DONE)


def _analyse(words: Sequence[str]) -> int:
    """Run one analysis and return its exit code; no error ends the worker."""
    from dashred.pipeline.analyse import main as analyse

    try:
        return analyse(list(words))
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return WRONG_INPUT
    except Exception:  # The worker must go on to analyse the next recording.
        traceback.print_exc()
        return OUR_FAILURE


@contextmanager
def _print_to(path: str) -> Iterator[None]:
    """Redirect stdout and stderr to a file, including the output of compiled libraries."""
    streams = (sys.stdout, sys.stderr)
    saved = [os.dup(stream.fileno()) for stream in streams]
    with open(path, "wb") as log:
        for stream in streams:
            os.dup2(log.fileno(), stream.fileno())
        try:
            yield
        finally:
            for stream, old in zip(streams, saved, strict=True):
                stream.flush()
                os.dup2(old, stream.fileno())
                os.close(old)


if __name__ == "__main__":
    sys.exit(run_entry(main))
