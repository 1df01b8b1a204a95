"""Shares with confidence intervals, and medians of known values."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from math import nan
from statistics import median


def wilson(successes: int, n: int) -> tuple[float, float]:
    """Return the Wilson 95 % interval of a share; (0, 1) if n is 0."""
    if n == 0:
        return 0.0, 1.0
    # Imported late: it takes a second to import, and --help does not need it.
    from scipy.stats import binomtest

    interval = binomtest(successes, n).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


@dataclass(frozen=True)
class Rate:
    """A number of successes out of n."""

    successes: int
    n: int

    @classmethod
    def of(cls, outcomes: Iterable[bool | None]) -> Rate:
        """Count the true values among those that are not None."""
        known = [outcome for outcome in outcomes if outcome is not None]
        return cls(sum(known), len(known))

    @property
    def share(self) -> float:
        """The fraction of successes; NaN if n is 0."""
        return self.successes / self.n if self.n else nan

    @cached_property
    def _interval(self) -> tuple[float, float]:
        return wilson(self.successes, self.n)

    @property
    def low(self) -> float:
        """Lower end of the Wilson 95 % interval."""
        return self._interval[0]

    @property
    def high(self) -> float:
        """Upper end of the Wilson 95 % interval."""
        return self._interval[1]

    @property
    def interval(self) -> str:
        """The Wilson interval as text: ``71-94 %``."""
        return f"{percent(self.low)}-{percent(self.high)} %" if self.n else ""

    def __str__(self) -> str:
        """Return the text for a table: ``31/36 = 86 % (71-94 %)``."""
        if not self.n:
            return "–"
        return f"{self.successes}/{self.n} = {percent(self.share)} % ({self.interval})"


def percent(share: float) -> str:
    """Return a share in percent with two digits, without the sign: ``86``, ``2.8``, ``100``."""
    value = 100 * share
    # 9.96 would become 10 with two digits, and 99.6 must not become 1e+02.
    return f"{value:.0f}" if abs(value) >= 9.95 else f"{value:.2g}"


def median_of(values: Iterable[float | None]) -> tuple[float | None, int]:
    """Return the median and the number of the values that are not None."""
    known = [value for value in values if value is not None]
    return (median(known) if known else None), len(known)
