"""Outcomes of the analysis: exact, listed, wrong and unflagged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dashred.evaluation.benchmark.record import Record
from dashred.evaluation.comparison.ratios import ComparedRow


@dataclass(frozen=True)
class ClaimCounts:
    """Counts of outcomes over rows; failed rows are counted as not right.

    Attributes:
        laws: rows with a hidden law.
        exact: rows among them whose best law is exact.
        listed: ambiguous rows among the others that list the hidden law.
        others: rows without a hidden law: none, a sensor fault, or a distant start.
        right: rows among them with the right verdict.
        wrong_unflagged: rows with a wrong verdict that is not flagged as uncertain.
        failed: rows without a verdict.
    """

    laws: int
    exact: int
    listed: int
    others: int
    right: int
    wrong_unflagged: int
    failed: int


def count_claims(rows: Sequence[ComparedRow]) -> ClaimCounts:
    """Count the outcomes of the analysis over rows."""
    laws = [row for row in rows if row.record["law"]]
    others = [row for row in rows if not row.record["law"]]
    inexact = [row for row in laws if not is_right(row.record)]
    return ClaimCounts(
        laws=len(laws),
        exact=len(laws) - len(inexact),
        listed=sum(bool(row.listed) for row in inexact),
        others=len(others),
        right=sum(is_right(row.record) for row in others),
        wrong_unflagged=sum(wrong_unflagged(row.record) for row in rows),
        failed=sum(row.record["problem"] is not None for row in rows),
    )


def is_right(record: Record) -> bool:
    """Return whether the law is exact or, if no law is hidden, whether the cause is right."""
    if record["problem"] is not None:
        return False
    if record["law"]:
        return record["exact_support"] is True
    if record["null"]:
        return bool(record["verdict"] == "nothing-missing")
    return record.get("cause_right") is True


def wrong_unflagged(record: Record) -> bool:
    """Return whether the verdict is wrong and not flagged as uncertain."""
    return record["problem"] is None and not is_right(record) and not record["flagged"]
