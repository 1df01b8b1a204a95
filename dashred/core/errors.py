"""The one error a user sees, and how an entry point ends."""

from __future__ import annotations

import difflib
import os
import sys
from collections.abc import Callable, Iterable

from dashred.core.system_errors import describe

DONE, OUR_FAILURE, WRONG_INPUT, INTERRUPTED = 0, 1, 2, 130


class InputError(Exception):
    """Something the user gave is wrong: what, where, and what to do about it.

    Attributes:
        what: the fault, as one plain sentence without a full stop.
        where: file with line or column, a key, or ``command line``.
        hint: what to do, or the nearest valid choice.
    """

    def __init__(self, what: str, *, where: str | None = None, hint: str | None = None) -> None:
        """Hold the three parts; see the class."""
        # The three parts go to Exception too, so that the error survives a process boundary.
        super().__init__(what, where, hint)
        self.what = what
        self.where = where
        self.hint = hint

    def __reduce__(self) -> tuple[object, ...]:
        """Rebuild from keywords: pickle would pass all three by position."""
        return _rebuild, (self.what, self.where, self.hint)

    def __str__(self) -> str:
        """``WHERE: WHAT``, and the hint indented on a second line."""
        first = f"{self.where}: {self.what}" if self.where else self.what
        return f"{first}\n  {self.hint}" if self.hint else first


def _rebuild(what: str, where: str | None, hint: str | None) -> InputError:
    return InputError(what, where=where, hint=hint)


def nearest(name: str, known: Iterable[str]) -> str:
    """Return a hint: the known name most like ``name``, or all of them."""
    choices = list(dict.fromkeys(known))
    close = difflib.get_close_matches(name, choices, n=1)
    return f"did you mean {close[0]}?" if close else f"one of: {', '.join(choices) or 'none'}"


def run_entry(main: Callable[[list[str]], int]) -> int:
    """Run ``main`` on the command line's words and return the process's exit code.

    An :class:`InputError` is printed to stderr, without a traceback, and gives 2; what the machine
    refuses, a full disk for example, likewise and gives 1; Ctrl-C gives 130. Anything else is a
    failure of ours: it propagates, and Python ends with 1. A reader that has closed our output,
    such as ``head``, knows that it has: nothing is said, and 1 returned.
    """
    try:
        try:
            return main(sys.argv[1:])
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        # What is left in the buffer would be written, and refused once more, at the very end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OUR_FAILURE
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return WRONG_INPUT
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    except Exception as error:
        if (said := describe(error)) is None:
            raise
        print(f"error: {said}", file=sys.stderr)
        return OUR_FAILURE
