"""The error for invalid user input, and the exit codes of commands."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

DONE, OUR_FAILURE, WRONG_INPUT, INTERRUPTED = 0, 1, 2, 130


class InputError(Exception):
    """Invalid user input.

    Attributes:
        what: the problem, as one plain sentence without a full stop.
        where: file with line or column, a configuration key, or ``command line``.
        hint: how to fix it, or the nearest valid choice.
    """

    def __init__(self, what: str, *, where: str | None = None, hint: str | None = None) -> None:
        """Store the three parts; see the class."""
        # Exception gets the three parts too, so that the error can cross a process boundary.
        super().__init__(what, where, hint)
        self.what = what
        self.where = where
        self.hint = hint

    def __reduce__(self) -> tuple[object, ...]:
        """Rebuild from keywords; pickle would pass all three by position."""
        return _rebuild, (self.what, self.where, self.hint)

    def __str__(self) -> str:
        """Return ``WHERE: WHAT``, with the hint indented on a second line."""
        first = f"{self.where}: {self.what}" if self.where else self.what
        return f"{first}\n  {self.hint}" if self.hint else first


def _rebuild(what: str, where: str | None, hint: str | None) -> InputError:
    return InputError(what, where=where, hint=hint)


def nearest(name: str, known: Iterable[str]) -> str:
    """Return a hint: the known name closest to ``name``, or else all known names."""
    choices = list(dict.fromkeys(known))
    close = difflib.get_close_matches(name, choices, n=1)
    return f"did you mean {close[0]}?" if close else f"one of: {', '.join(choices) or 'none'}"
