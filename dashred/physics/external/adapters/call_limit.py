"""A time limit for code in this process, which cannot be killed as another process can."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

# After the limit the code is interrupted again and again: it may have caught the first exception.
AGAIN = 1.0
# Longest time that is set, in s: a timer takes no more than about 9e9.
LONGEST = 1e9


class OverrunError(BaseException):
    """Code took longer than its limit; no ``except Exception`` of a user's code catches it."""


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Raise an error in the code within once it has taken so many seconds.

    A timer interrupts the interpreter in the main thread, between two of its instructions or in a
    call that waits. Native code that does not return is not interrupted. In other threads, and on
    systems without such timers, there is no limit.

    Args:
        seconds: of wall-clock time; infinite for no limit.

    Raises:
        OverrunError: from the code within.
    """
    if threading.current_thread() is not threading.main_thread() or not hasattr(
        signal, "setitimer"
    ):
        yield
        return

    def interrupt(*_: Any) -> None:
        raise OverrunError

    before, begun = signal.signal(signal.SIGALRM, interrupt), time.monotonic()
    left, interval = signal.setitimer(signal.ITIMER_REAL, min(seconds, LONGEST), AGAIN)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
        if left:
            # The timer of the caller goes on.
            rest = left - (time.monotonic() - begun)
            signal.setitimer(signal.ITIMER_REAL, max(rest, 1e-6), interval)
