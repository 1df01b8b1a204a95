"""Analyse one recording after another: ``python -m dashred.pipeline.worker``.

Imports and compiled kernels serve all recordings. Each line of stdin is JSON with the words of one
analysis and the file that it prints to: ``{"words": [...], "log": FILE}``. Each is answered by a
line of JSON on stdout: ``{"code": 0, "cpu_seconds": 61.2}``.
"""

from __future__ import annotations

import json
import os
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from dashred.core.errors import DONE, OUR_FAILURE, WRONG_INPUT, InputError, run_entry


def main(argv: list[str]) -> int:
    """Answer every line, until there are no more."""
    with os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8") as answers:
        for line in sys.stdin:
            told = json.loads(line)
            began = time.process_time()
            with _printing_to(told["log"]):
                code = _analyse(told["words"])
            spent = round(time.process_time() - began, 2)
            print(json.dumps({"code": code, "cpu_seconds": spent}), file=answers, flush=True)
    return DONE


def _analyse(words: Sequence[str]) -> int:
    """Run one analysis; whatever goes wrong with it is its own affair."""
    from dashred.pipeline.analyse import main as analyse

    try:
        return analyse(list(words))
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return WRONG_INPUT
    except Exception:  # The next recording has a right to its analysis.
        traceback.print_exc()
        return OUR_FAILURE


@contextmanager
def _printing_to(path: str) -> Iterator[None]:
    """Send everything that is printed to a file, by whatever library and in whatever language."""
    streams = (sys.stdout, sys.stderr)
    before = [os.dup(stream.fileno()) for stream in streams]
    with open(path, "wb") as log:
        for stream in streams:
            os.dup2(log.fileno(), stream.fileno())
        try:
            yield
        finally:
            for stream, old in zip(streams, before, strict=True):
                stream.flush()
                os.dup2(old, stream.fileno())
                os.close(old)


if __name__ == "__main__":
    sys.exit(run_entry(main))
