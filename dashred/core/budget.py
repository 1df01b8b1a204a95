"""The time that a run may take, and what it did not suffice for."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


class OutOfTimeError(Exception):
    """The time for a part of a run is spent; whoever holds a result so far catches it."""


@dataclass(frozen=True)
class Deadline:
    """A point in time.

    Attributes:
        at: seconds on the clock of :func:`time.monotonic`.
    """

    at: float = math.inf

    @property
    def is_over(self) -> bool:
        """Whether the time is up."""
        return self.is_over_in(0.0)

    def is_over_in(self, seconds: float) -> bool:
        """Whether the time is up after so many seconds from now."""
        return time.monotonic() + seconds > self.at

    def part(self, share: float) -> Deadline:
        """Return the time at which a share of what is left until the deadline is over."""
        now = time.monotonic()
        return Deadline(now + share * (self.at - now))

    def check(self) -> None:
        """Raise an error if the time is up.

        Raises:
            OutOfTimeError: it is.
        """
        if self.is_over:
            raise OutOfTimeError


NEVER = Deadline()


def cpu_seconds() -> float:
    """Return the CPU seconds of this process, its threads, and processes that it has ended."""
    return sum(os.times()[:4])


def duration(clock: float, cpu: float) -> str:
    """Return a duration in words: ``75 s (12 s of CPU)``. A busy machine gives little CPU."""
    return f"{clock:.3g} s ({cpu:.2g} s of CPU)"


def in_time(compute: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Return the results for some items, in order, as far as the time allows."""
    results = []
    for item in items:
        try:
            results.append(compute(item))
        except OutOfTimeError:
            break
    return results


@dataclass(frozen=True)
class Budget:
    """The time of one run.

    Attributes:
        seconds: length of the run; infinite without a bound.
        began: start of the run, on the clock of :func:`time.monotonic`.
        began_cpu: CPU seconds of the process at the start (:func:`cpu_seconds`).
        not_tried: what was left out or stopped early for lack of time, in order.
    """

    seconds: float = math.inf
    began: float = 0.0
    began_cpu: float = 0.0
    not_tried: list[str] = field(default_factory=list)

    @classmethod
    def begin(cls, seconds: float) -> Budget:
        """Return a budget whose time begins now."""
        return cls(seconds, time.monotonic(), cpu_seconds())

    @property
    def spent(self) -> float:
        """Seconds since the start."""
        return time.monotonic() - self.began

    @property
    def cpu(self) -> float:
        """CPU seconds since the start."""
        return cpu_seconds() - self.began_cpu

    @property
    def left(self) -> float:
        """Seconds that are left; negative after the end."""
        return self.seconds - self.spent

    def deadline(self, share: float) -> Deadline:
        """Return the time at which a share of the whole run is over."""
        return Deadline(self.began + share * self.seconds)

    def leave_out(self, what: str) -> None:
        """Note something that was not tried."""
        if what not in self.not_tried:
            self.not_tried.append(what)

    def attempt(self, what: str, compute: Callable[[], Result], otherwise: Result) -> Result:
        """Return a result, or what to use in its place if there is no time for it.

        Args:
            what: the name of the part, for the list of what was not tried.
            compute: computes the result; it may raise :class:`OutOfTimeError`.
            otherwise: the result without it.
        """
        try:
            return compute()
        except OutOfTimeError:
            self.leave_out(what)
            return otherwise
