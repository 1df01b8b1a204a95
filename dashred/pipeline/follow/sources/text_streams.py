"""A growing file and standard input."""

from __future__ import annotations

import os
import select
import sys
import time
from pathlib import Path

from dashred.core.errors import InputError
from dashred.pipeline.follow.remarks import Remarks
from dashred.pipeline.follow.sources.messages import LineReader, Message

# Bytes that are read at once, and seconds between looks at the end of a file.
BLOCK, POLL = 1 << 16, 0.05


class GrowingFile:
    """A CSV, or lines of JSON, to which another program appends: ``tail -f``.

    It never ends. If it becomes shorter, it was begun again, and is read from its beginning.

    Raises:
        InputError: there is no such file, or it cannot be read.
    """

    def __init__(self, path: Path, remarks: Remarks) -> None:
        self._path, self._remarks = path, remarks
        self.ended = False
        try:
            self._file = path.open("rb")
        except OSError as error:
            hint = "give a file, - for standard input, or mqtt:// or ws:// with an address"
            what = f"this source cannot be read: {error.strerror}"
            raise InputError(what, where=str(path), hint=hint) from None
        self._lines = LineReader(str(path), remarks)

    def read(self, timeout: float) -> list[Message]:
        """Return the messages of new lines."""
        end = time.monotonic() + timeout
        while True:
            block = self._file.read(BLOCK)
            messages = self._lines.feed(block.decode("utf-8", errors="replace"))
            if messages or (not block and time.monotonic() >= end):
                return messages
            if not block:
                self._look_for_a_new_beginning()
                time.sleep(min(POLL, max(0.0, end - time.monotonic())))

    def _look_for_a_new_beginning(self) -> None:
        if os.fstat(self._file.fileno()).st_size >= self._file.tell():
            return
        self._remarks.once("shorter", f"{self._path} has become shorter: it is read from the start")
        self._file.seek(0)
        self._lines = LineReader(str(self._path), self._remarks)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class StandardInput:
    """A CSV, or lines of JSON, on standard input, until its end."""

    def __init__(self, remarks: Remarks) -> None:
        self.ended = False
        self._descriptor = sys.stdin.fileno()
        self._lines = LineReader("standard input", remarks)

    def read(self, timeout: float) -> list[Message]:
        """Return the messages of new lines."""
        ready, _, _ = select.select([self._descriptor], [], [], timeout)
        if not ready:
            return []
        block = os.read(self._descriptor, BLOCK)
        self.ended = not block
        if self.ended:
            return self._lines.finish()
        return self._lines.feed(block.decode("utf-8", errors="replace"))

    def close(self) -> None:
        """Leave standard input open."""
