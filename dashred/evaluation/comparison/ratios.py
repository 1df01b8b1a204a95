"""Summaries of compared rows: RMSE ratios, and terms found, spurious and missed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from dashred.core.findings.methods import LABELS, SHRED_UNCHANGED
from dashred.evaluation.baselines.analyse import NOT_FOR_SYSTEM
from dashred.evaluation.benchmark.record import Record
from dashred.evaluation.comparison.comparison_file import MethodScore

# Reference of the error ratios: the unchanged simulator from the same start.
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


# Methods that every analysis has; if law is missing, it counts as lost.
ANALYSIS_METHODS = ("shred", "dashred", "corrected", "corrected_shred")
ANALYSIS_LAW = "corrected"


@dataclass(frozen=True)
class ComparedRow:
    """One experiment.

    Attributes:
        record: record of the benchmark.
        methods: scores by method; empty if nothing could be compared.
        folder: folder of its files.
        problem: why some methods could not be compared; None if all were.
        listed: whether an ambiguous verdict lists the true law.
        git_commit: commit of the scorer.
    """

    record: Record
    methods: dict[str, MethodScore]
    folder: Path
    problem: str | None = None
    listed: bool | None = None
    git_commit: str | None = None

    def ratio(self, method: str) -> float | None:
        """Return the RMSE of a method over that of the reference; infinite if lost."""
        score, reference = (self.methods.get(name) for name in (method, REFERENCE))
        if self.lost(method):
            return math.inf
        if score is None or score["rmse"] is None or not reference or not reference["rmse"]:
            return None
        return score["rmse"] / reference["rmse"]

    def lost(self, method: str) -> bool:
        """Return whether a method failed, or belongs to an analysis without any scores."""
        score = self.methods.get(method)
        return (
            score["failed"] is not None
            if score
            else not self.methods and method in ANALYSIS_METHODS
        )


@dataclass(frozen=True)
class FieldRatio:
    """RMSE of a method over that of the reference, over rows.

    Attributes:
        median: median ratio, where a lost method counts as infinite; None if no row has both.
        rows: rows with a hidden law that reached this method.
        lost: rows among them in which the method failed.
    """

    median: float | None
    rows: int
    lost: int


@dataclass(frozen=True)
class LawCount:
    """Numbers of terms over rows.

    Attributes:
        rows: rows in which the method sought a law.
        exact: rows among them with exactly the true terms.
        failed: rows among them in which the method failed; rows without scores are not included in
            the following counts.
        found: true terms found.
        spurious: terms found that are not true.
        missed: true terms not found, also in rows without a law.
        error: median over rows of the largest relative error of the coefficients found.
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
    """Return the rows by system and noise, in order of first appearance."""
    found: dict[tuple[str, float], list[ComparedRow]] = {}
    for row in rows:
        found.setdefault((row.record["system"], row.record["noise"]), []).append(row)
    return found


def field_ratio(rows: Iterable[ComparedRow], method: str) -> FieldRatio | None:
    """Return the RMSE ratio of a method over rows with a hidden law; None if it has no fields.

    Rows without a hidden law are excluded: their reference, the simulator from the fitted start,
    cannot be improved.
    """
    hiding = [row for row in rows if row.record["law"]]
    if not hiding or not _has_fields(hiding, method):
        return None
    known = [ratio for row in hiding if (ratio := row.ratio(method)) is not None]
    lost = sum(row.lost(method) for row in hiding)
    asked = sum(row.lost(method) or method in row.methods for row in hiding)
    return FieldRatio(median(known) if known else None, asked, lost)


def _has_fields(rows: Sequence[ComparedRow], method: str) -> bool:
    """Return whether a method applies to these rows, even if it failed in all of them."""
    scores = [row.methods[method] for row in rows if method in row.methods]
    if any(score["note"] == NOT_FOR_SYSTEM for score in scores):
        return False
    return bool(scores) or method in ANALYSIS_METHODS


def count_laws(rows: Iterable[ComparedRow], method: str) -> LawCount | None:
    """Return the counts of the laws of a method; None if it does not seek a law."""
    all_rows = list(rows)
    laws = [row.methods[method] for row in all_rows if method in row.methods]
    laws = [law for law in laws if law["exact"] is not None]
    if not all_rows or not (laws or method == ANALYSIS_LAW):
        return None
    # In rows without scores only the analysis was run, and its missed terms are unknown.
    unscored = sum(not row.methods for row in all_rows) if method == ANALYSIS_LAW else 0
    errors = [law["coefficient_error"] for law in laws if law["coefficient_error"] is not None]
    return LawCount(
        rows=len(laws) + unscored,
        exact=sum(bool(law["exact"]) for law in laws),
        failed=unscored + sum(law["failed"] is not None for law in laws),
        found=sum(law["found"] or 0 for law in laws),
        spurious=sum(law["spurious"] or 0 for law in laws),
        missed=sum(law["missed"] or 0 for law in laws),
        error=median(errors) if errors else None,
    )


def median_seconds(rows: Iterable[ComparedRow], method: str) -> float | None:
    """Return the median seconds of a method over the rows in which they are known."""
    scores = [row.methods[method] for row in rows if method in row.methods]
    applicable = [score["seconds"] for score in scores if score["note"] != NOT_FOR_SYSTEM]
    known = [seconds for seconds in applicable if seconds is not None]
    return median(known) if known else None


def left_unchanged(rows: Iterable[ComparedRow]) -> tuple[int, int]:
    """Return the number of rows in which DA-SHRED equals SHRED, and the number that have both."""
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
