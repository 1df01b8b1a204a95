"""Time steps between output times."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple


class Step(NamedTuple):
    """One step from ``t`` to ``t + h``.

    Attributes:
        begins, ends: whether the step starts or ends at an output time.
    """

    t: float
    h: float
    begins: bool
    ends: bool


def schedule(times: Sequence[float], dt: float) -> Iterator[Step]:
    """Yield equal steps of at most ``dt`` between output times."""
    for begin, end in pairwise(times):
        count = max(1, round_up((end - begin) / dt))
        # Rounded, so that intervals equal up to rounding errors share the coefficients of a step.
        h = float(f"{(end - begin) / count:.12g}")
        for i in range(count):
            yield Step(begin + i * h, h, i == 0, i == count - 1)


def round_up(ratio: float) -> int:
    """Round up to a whole number of steps, tolerating rounding errors: 15.0000001 → 15."""
    return int(-(-(ratio - 1e-6) // 1))
