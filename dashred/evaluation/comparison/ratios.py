"""What rows of a comparison come to: ratios of RMSE, and terms found, spurious and missed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from dashred.core.findings.methods import LABELS, SHRED_UNCHANGED
from dashred.evaluation.baselines.analyse import NOT_FOR_SYSTEM
from dashred.evaluation.benchmark.record import Record
from dashred.evaluation.comparison.kept_comparison import Compared

# The field that errors are told relative to: the simulator as it is, from the same start.
REFERENCE = "simulation_same_start"
FIELDS = {
    name: label
    for name, label in LABELS.items()
    if name not in ("truth", "recorded", "nearest_snapshots", SHRED_UNCHANGED)
} | {"filter_augmented": "the same, with coefficients"}
LAWS = {
    "latent_alg1": "latent SINDy, Algorithm 1",
    "latent_alg2": "latent SINDy, Algorithm 2",
    "filter_augmented": "ensemble Kalman filter with coefficients",
    "closed_form": "closed form of linear systems",
    "pde_find": "PDE-FIND, given the full noisy field",
    "corrected": "dashred",
}


# What an analysis always has, so that without one it is lost.
OURS = ("shred", "dashred", "corrected", "corrected_shred")
LAW_OF_OURS = "corrected"


@dataclass(frozen=True)
class ComparedRow:
    """One experiment.

    Attributes:
        record: of the bench; of a row that failed, its problem.
        methods: how right each method is; none where nothing could be compared.
        folder: where its files are.
        problem: why nothing could be compared, or the other methods not; None where all went well.
        listed: of an ambiguous verdict, whether the true law is listed.
        git_commit: of the code that compared.
    """

    record: Record
    methods: dict[str, Compared]
    folder: Path
    problem: str | None = None
    listed: bool | None = None
    git_commit: str | None = None

    def ratio(self, method: str) -> float | None:
        """Return a method's RMSE over the reference's; infinite where the method was lost."""
        told, reference = (self.methods.get(name) for name in (method, REFERENCE))
        if self.lost(method):
            return math.inf
        if told is None or told["rmse"] is None or not reference or not reference["rmse"]:
            return None
        return told["rmse"] / reference["rmse"]

    def lost(self, method: str) -> bool:
        """Return whether a method failed; of a row without any, whether it is the analysis'."""
        told = self.methods.get(method)
        return told["failed"] is not None if told else not self.methods and method in OURS


@dataclass(frozen=True)
class FieldRatio:
    """RMSE over the reference's, of some rows.

    Attributes:
        median: a lost method's is infinite; None where no row has both.
        rows: that hide a law and got as far as this method.
        lost: of them, those where the method failed.
    """

    median: float | None
    rows: int
    lost: int


@dataclass(frozen=True)
class LawCount:
    """Terms over some rows.

    Attributes:
        rows: in which the method was asked for a law.
        exact: of them, where it found all terms and no others.
        failed: of them, where it failed; their terms are in none of the counts that follow where
            nothing could be scored.
        found: true terms found.
        spurious: terms found that are not there.
        missed: true terms not found, those of rows without a law among them.
        error: median over rows of the worst relative error of the coefficients found.
    """

    rows: int
    exact: int
    failed: int
    found: int
    spurious: int
    missed: int
    error: float | None


def own_layout(rows: Iterable[ComparedRow]) -> list[ComparedRow]:
    """Return the rows with the system's own number of sensors."""
    return [r for r in rows if r.record["sensors"] is None and r.record["extra"] is None]


def groups(rows: Sequence[ComparedRow]) -> dict[tuple[str, float], list[ComparedRow]]:
    """Return the rows by system and noise, in the order in which they first come."""
    found: dict[tuple[str, float], list[ComparedRow]] = {}
    for row in rows:
        found.setdefault((row.record["system"], row.record["noise"]), []).append(row)
    return found


def field_ratio(rows: Iterable[ComparedRow], method: str) -> FieldRatio | None:
    """Return what a method's fields come to, over rows that hide a law; None if it has none.

    Where no law is hidden there is nothing to gain: with a wrong sensor or a far start, too, the
    reference is the simulator from the start that was found.
    """
    hiding = [row for row in rows if row.record["law"]]
    if not hiding or not _has_fields(hiding, method):
        return None
    known = [ratio for row in hiding if (ratio := row.ratio(method)) is not None]
    lost = sum(row.lost(method) for row in hiding)
    asked = sum(row.lost(method) or method in row.methods for row in hiding)
    return FieldRatio(median(known) if known else None, asked, lost)


def _has_fields(rows: Sequence[ComparedRow], method: str) -> bool:
    """Return whether a method is one for these rows: a failure of all says nothing against it."""
    told = [row.methods[method] for row in rows if method in row.methods]
    if any(one["note"] == NOT_FOR_SYSTEM for one in told):
        return False
    return bool(told) or method in OURS


def count_laws(rows: Iterable[ComparedRow], method: str) -> LawCount | None:
    """Return what a method's laws come to; None where it is asked for none."""
    some = list(rows)
    laws = [row.methods[method] for row in some if method in row.methods]
    laws = [one for one in laws if one["exact"] is not None]
    if not some or not (laws or method == LAW_OF_OURS):
        return None
    # Of rows with nothing to compare it is not known how many terms were missed, and only the
    # analysis had its chance.
    unscored = sum(not row.methods for row in some) if method == LAW_OF_OURS else 0
    errors = [one["coefficient_error"] for one in laws if one["coefficient_error"] is not None]
    return LawCount(
        rows=len(laws) + unscored,
        exact=sum(bool(one["exact"]) for one in laws),
        failed=unscored + sum(one["failed"] is not None for one in laws),
        found=sum(one["found"] or 0 for one in laws),
        spurious=sum(one["spurious"] or 0 for one in laws),
        missed=sum(one["missed"] or 0 for one in laws),
        error=median(errors) if errors else None,
    )


def median_seconds(rows: Iterable[ComparedRow], method: str) -> float | None:
    """Return the median of a method's seconds over the rows where it is known."""
    told = [row.methods[method] for row in rows if method in row.methods]
    taken = [one["seconds"] for one in told if one["note"] != NOT_FOR_SYSTEM]
    known = [seconds for seconds in taken if seconds is not None]
    return median(known) if known else None


def left_unchanged(rows: Iterable[ComparedRow]) -> tuple[int, int]:
    """Return in how many rows DA-SHRED's field is SHRED's, and how many have both."""
    both = [
        (row.methods["shred"]["rmse"], row.methods["dashred"]["rmse"])
        for row in rows
        if {"shred", "dashred"} <= row.methods.keys()
    ]
    known = [pair for pair in both if None not in pair]
    return sum(before == after for before, after in known), len(known)


def as_metrics(rows: Sequence[ComparedRow]) -> dict[str, float]:
    """Return the median ratios by name: ``rde/noise 0.05/ratio/corrected``."""
    return {
        f"{system}/noise {noise:g}/ratio/{method}": ratio.median
        for (system, noise), group in groups(rows).items()
        for method in FIELDS
        if (ratio := field_ratio(group, method)) is not None and ratio.median is not None
    }
