"""How long a call of a program may take."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import monotonic

# Each further state of a call may take so many times what one took in the first call.
FURTHER = 10
# Once a call has taken too long, others may take so many times what the first one took for a state,
# and at least so many seconds: a program that hangs at some states would use up the budget.
SPARE, LEAST = 100, 1.0
# They may also take so many times what the slowest one took until then, for example because the
# first one began at rest.
SLOWER = 2


@dataclass
class Patience:
    """The longest time of a call, which follows from the number of its states.

    Attributes:
        limit: longest time for one state, in s; infinite for no limit.
        each: time that one state took in the first call, in s.
        slowest: the longest time of a call that has ended, by state, in s.
    """

    limit: float
    each: float = 0.0
    slowest: float = 0.0

    def of(self, count: int) -> float:
        """Return the longest time of a call with so many states, in s."""
        return self.limit + FURTHER * self.each * (count - 1)

    @contextmanager
    def call(self, count: int) -> Iterator[float]:
        """Give the longest time of the call within, which has so many states, and time it."""
        longest, began = self.of(count), monotonic()
        try:
            yield longest
        except BaseException:
            if self.each and monotonic() - began > 0.99 * longest:
                needed = max(SPARE * self.each, SLOWER * self.slowest, LEAST)
                self.limit = min(self.limit, needed)
            raise
        took = (monotonic() - began) / count
        self.each, self.slowest = self.each or took, max(self.slowest, took)
