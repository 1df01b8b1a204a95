"""Limits and units in type annotations: ``points: Annotated[int, Limit(at_least=8)]``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated


@dataclass(frozen=True)
class Limit:
    """Bounds on a number."""

    at_least: float | None = None
    above: float | None = None
    below: float | None = None
    at_most: float | None = None

    def holds(self, value: float) -> bool:
        """Return whether ``value`` is within the bounds."""
        return (
            (self.at_least is None or value >= self.at_least)
            and (self.above is None or value > self.above)
            and (self.below is None or value < self.below)
            and (self.at_most is None or value <= self.at_most)
        )

    def __str__(self) -> str:
        """Return the bounds in words: ``above 0 and below 0.9``."""
        bounds = {"at least": self.at_least, "above": self.above, "below": self.below}
        bounds |= {"at most": self.at_most}
        return " and ".join(f"{word} {x:.10g}" for word, x in bounds.items() if x is not None)


@dataclass(frozen=True)
class Unit:
    """Unit of a number: ``Annotated[Positive, Unit("samples")]``."""

    name: str


# The upper bound catches typing errors.
Count = Annotated[int, Limit(at_least=1, at_most=1_000_000)]
Positive = Annotated[float, Limit(above=0)]
NonNegative = Annotated[float, Limit(at_least=0)]
Time = Annotated[Positive, Unit("the system's time")]
