"""The targets of the proof, and whether the records meet them.

A share is compared with its target without its interval. Records without a value are not counted;
the number of counted records is given with each value.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from dashred.evaluation.proof.cases.case_record import (
    KINDS,
    CaseRecord,
    Coefficient,
    Gain,
    Kind,
    name_of,
)
from dashred.evaluation.proof.scoring import outcomes
from dashred.evaluation.proof.scoring.statistics import Rate, median_of

Records = Sequence[CaseRecord]
Unit = Literal[" %", "", "×", " s"]
Outcome = Literal["met", "not met", "no data"]

LAWLESS: tuple[Kind, ...] = ("start", "fault", "numerics")
# Kinds with fewer cases than this are pooled.
FEW = 30
POOLS: dict[str, tuple[Kind, ...]] = {
    "start, numerics, sensor": ("start", "numerics", "fault"),
    "parameter, terms, hidden field": ("parameter", "terms", "hidden"),
    "region, state, onset": ("box", "gate", "onset"),
    "outside, masked": ("outside", "masked"),
}
REGION_OF: dict[Kind, Literal["overlap", "onset", "threshold"]] = {
    "box": "overlap",
    "onset": "onset",
    "gate": "threshold",
}


@dataclass(frozen=True)
class Measured:
    """A share or another number from `n` values, with an optional note for the reader."""

    value: Rate | float | None
    n: int
    note: str = ""

    @property
    def number(self) -> float | None:
        """The number to compare with the target; None if n is 0."""
        if not self.n:
            return None
        return self.value.share if isinstance(self.value, Rate) else self.value


Measure = Callable[[Records], Measured]


@dataclass(frozen=True)
class Target:
    """A target: at least `low`, at most `high`; shares are fractions."""

    name: str
    measure: Measure
    low: float | None = None
    high: float | None = None
    unit: Unit = " %"

    def outcome(self, measured: Measured) -> Outcome:
        """Return whether a measured value meets the target."""
        number = measured.number
        if number is None:
            return "no data"
        above = self.low is None or number >= self.low
        below = self.high is None or number <= self.high
        return "met" if above and below else "not met"


def cases(records: Records) -> list[CaseRecord]:
    """Return the scored cases, without nulls."""
    return [record for record in records if record["group"] == "cases"]


def nulls(records: Records) -> list[CaseRecord]:
    """Return the nulls, which are counted separately."""
    return [record for record in records if record["group"] == "nulls"]


def of_kind(records: Records, *kinds: Kind) -> list[CaseRecord]:
    """Return the scored cases of these kinds."""
    return [record for record in cases(records) if record["kind"] in kinds]


def coefficients(records: Records) -> list[Coefficient]:
    """Return the coefficients of all exact laws of the scored cases."""
    return [found for record in cases(records) for found in record["coefficients"]]


def coverage(found: Iterable[Coefficient]) -> Rate:
    """Return how many stated 95 % intervals cover the true coefficient."""
    return Rate.of(coefficient["covered"] for coefficient in found)


def _share(
    outcome: Callable[[CaseRecord], bool | None],
    among: Callable[[Records], list[CaseRecord]] = cases,
    note: Callable[[Records], str] = lambda _: "",
) -> Measure:
    """Return a function that measures the share of records for which `outcome` is true."""

    def measure(records: Records) -> Measured:
        rate = Rate.of(map(outcome, among(records)))
        return Measured(rate, rate.n, note(records))

    return measure


def _median(
    value: Callable[[CaseRecord], float | None], note: Callable[[Records], str] = lambda _: ""
) -> Measure:
    """Return a function that measures the median of a value over the scored cases."""

    def measure(records: Records) -> Measured:
        return Measured(*median_of(map(value, cases(records))), note(records))

    return measure


def _count_missing(kind: Kind) -> Callable[[Records], str]:
    """Return a function that describes how many cases lack the window and count as missed."""

    def note(records: Records) -> str:
        chosen = of_kind(records, kind)
        none = [r for r in chosen if r["region"] is None or r["region"][REGION_OF[kind]] is None]
        missed = sum(outcomes.could_be_found(record, kind) for record in none)
        if not none:
            return ""
        return f"{len(none)} of {len(chosen)} cases lack it, {missed} of which count as missed"

    return note


def _worst_undecidable(records: Records) -> Measured:
    rates = {
        name: Rate.of(map(_undecidable, of_kind(records, *kinds)))
        for name, kinds in _classes(records).items()
    }
    counted = [name for name, rate in rates.items() if rate.n]
    if not counted:
        return Measured(None, 0)
    worst = max(counted, key=lambda name: rates[name].share)
    return Measured(rates[worst], rates[worst].n, f"worst class: {worst}")


def _classes(records: Records) -> dict[str, tuple[Kind, ...]]:
    """Return the classes to score: kinds with few cases are pooled."""
    large = [kind for kind in KINDS if len(of_kind(records, kind)) >= FEW]
    classes: dict[str, tuple[Kind, ...]] = {KINDS[kind]: (kind,) for kind in large}
    for name, kinds in POOLS.items():
        classes[name] = tuple(kind for kind in kinds if kind not in large)
    return classes


def _undecidable(record: CaseRecord) -> bool | None:
    can = outcomes.decidable(record)
    return None if can is None else not can


def _coefficients_within(records: Records) -> Measured:
    rate = Rate.of(map(outcomes.coefficient_near, coefficients(records)))
    return Measured(rate, rate.n)


def _coefficient_error(records: Records) -> Measured:
    return Measured(*median_of(abs(c["found"] / c["true"] - 1) for c in coefficients(records)))


def _coverage(records: Records) -> Measured:
    rate = coverage(c for c in coefficients(records) if c["window"] is None)
    return Measured(rate, rate.n, "terms that act everywhere")


def _worst_on_noisy_data(records: Records) -> Measured:
    known = [(r["noisy_test"], r) for r in records if r["noisy_test"] is not None]
    if not known:
        return Measured(None, 0)
    value, record = max(known, key=lambda pair: pair[0])
    return Measured(value, len(known), f"worst: {name_of(record)}")


def _mean_seconds(records: Records) -> Measured:
    all_seconds = [record["seconds"] for record in cases(records) if record["system"] == "fhn"]
    known = [seconds for seconds in all_seconds if seconds is not None]
    return Measured(sum(known) / len(known) if known else None, len(known))


def _gain(name: str, at: Gain, low: float) -> Target:
    return Target(name, _median(lambda record: outcomes.gain(record, at)), low=low, unit="×")


TARGETS = (
    Target("verdict right", _share(lambda r: r["right"]), low=0.80),
    Target("right, or ambiguous with the truth listed", _share(lambda r: r["listed"]), low=0.92),
    Target("decidable cases: verdict and exact form", _share(outcomes.decided), low=0.90),
    Target("undecidable cases of a class", _worst_undecidable, high=0.25),
    Target("wrong and unflagged", _share(outcomes.wrong_unflagged), high=0.03),
    Target("not converged", _share(lambda r: outcomes.verdict_is("not-converged", r)), high=0.10),
    Target("search failures", _share(outcomes.search_failed), high=0.03),
    Target(
        "start, sensor fault, numerics: named",
        _share(lambda r: r["right"], lambda records: of_kind(records, *LAWLESS)),
        low=0.95,
    ),
    Target("false alarms on nulls", _share(outcomes.false_alarm, nulls), high=0.03),
    Target(
        "region: intersection over union, median",
        _median(outcomes.overlap, _count_missing("box")),
        low=0.85,
        unit="",
    ),
    Target("told place inside the region", _share(outcomes.place_inside), low=0.85),
    Target(
        "onset within 5 % of the record",
        _share(outcomes.onset_near, note=_count_missing("onset")),
        low=1.0,
    ),
    Target(
        "threshold within 10 % of the range or 2 std",
        _share(outcomes.threshold_near, note=_count_missing("gate")),
        low=1.0,
    ),
    Target("hidden field: right equation", _share(outcomes.equation_right), low=0.90),
    Target("coefficients within 5 % or 3 std", _coefficients_within, low=1.0),
    Target("error of coefficients, median", _coefficient_error, high=0.025),
    Target("95 % intervals that cover", _coverage, low=0.90, high=0.98),
    Target("outside the library: reported", _share(outcomes.outside_reported), low=0.85),
    Target(
        "reported as outside, but inside the library", _share(outcomes.false_outside), high=0.02
    ),
    _gain("gain at test sensors, median", "test_sensors_before", 5.0),
    _gain("gain at test sensors over the fitted start, median", "test_sensors", 5.0),
    _gain("gain of the forecast, median", "forecast_before", 10.0),
    _gain("gain of the forecast over the fitted start, median", "forecast", 10.0),
    Target("largest increase of the error on noisy test data", _worst_on_noisy_data, high=0.02),
    Target("seconds of an fhn case, mean", _mean_seconds, high=90.0, unit=" s"),
)
