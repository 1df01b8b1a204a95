"""Write the estimates row by row, as CSV or as lines of JSON."""

from __future__ import annotations

import json
import math
import os
import stat
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType

JSON_ENDINGS = (".jsonl", ".ndjson")
DIGITS = 7
NEW_FILE = 0o666


class Rows:
    """A file of rows, or standard output.

    Every write is of whole rows. If it fails, for example because the disk is full, the file is cut
    at the end of the last complete row.

    Args:
        path: the file; None is standard output.
        columns: names of the numbers, then of the texts.
    """

    def __init__(self, path: Path | None, columns: Sequence[str]) -> None:
        self._path, self._columns = path, columns
        self._is_json = path is not None and path.suffix.lower() in JSON_ENDINGS
        if path is None:
            sys.stdout.flush()
            self._descriptor = os.dup(sys.stdout.fileno())
        else:
            self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT, NEW_FILE)
        self._written = 0
        self._number = f"%.{DIGITS}g"
        if not self._is_json:
            self._write(f"{','.join(map(_cell, columns))}\n")

    def __enter__(self) -> Rows:
        """Return the open file."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the file."""
        self.close()

    def close(self) -> None:
        """Close the file."""
        os.close(self._descriptor)

    def write(self, rows: Sequence[tuple[Sequence[float], Sequence[str]]]) -> None:
        """Write rows of numbers and texts."""
        line = self._json if self._is_json else self._csv
        self._write("".join(line(numbers, texts) for numbers, texts in rows))

    def _csv(self, numbers: Sequence[float], texts: Sequence[str]) -> str:
        # The time keeps its digits.
        cells = [
            repr(float(numbers[0])),
            *(self._number % x if x == x else "" for x in numbers[1:]),
        ]
        return f"{','.join([*cells, *map(_cell, texts)])}\n"

    def _json(self, numbers: Sequence[float], texts: Sequence[str]) -> str:
        values = [numbers[0], *(float(self._number % x) for x in numbers[1:])]
        plain = [x if math.isfinite(x) else None for x in values]
        row = dict(zip(self._columns, [*plain, *texts], strict=True))
        return f"{json.dumps(row, ensure_ascii=False)}\n"

    def _write(self, text: str) -> None:
        left = memoryview(text.encode())
        try:
            while left:
                left = left[os.write(self._descriptor, left) :]
        except OSError as error:
            error.filename = None if self._path is None else str(self._path)
            self._cut()
            raise
        self._written += len(text.encode())

    def _cut(self) -> None:
        """Cut a regular file at the end of the last complete row."""
        with suppress(OSError):
            if self._path is not None and stat.S_ISREG(os.fstat(self._descriptor).st_mode):
                os.ftruncate(self._descriptor, self._written)


def _cell(text: str) -> str:
    if any(sign in text for sign in ',"\n'):
        return '"{}"'.format(text.replace('"', '""'))
    return text
