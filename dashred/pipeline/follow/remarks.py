"""Remarks on a stream: each kind is said once, and counted."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable


def _print(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


class Remarks:
    """Remarks that are said once.

    Args:
        say: prints a line; by default to standard error, beside the estimates.
    """

    def __init__(self, say: Callable[[str], None] = _print) -> None:
        self.say, self._counts = say, Counter[str]()

    def once(self, kind: str, text: str) -> None:
        """Say a remark the first time that its kind occurs, and count it."""
        self._counts[kind] += 1
        if self._counts[kind] == 1:
            self.say(f"remark: {text}")

    @property
    def counts(self) -> dict[str, int]:
        """How often each kind has occurred."""
        return dict(self._counts)
