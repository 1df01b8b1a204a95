"""How the analysis' own claims of one row went: exact, listed, wrong and unflagged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dashred.evaluation.benchmark.record import Record
from dashred.evaluation.comparison.ratios import ComparedRow


@dataclass(frozen=True)
class Claims:
    """What was claimed of some rows; rows that failed count among those asked, and are not right.

    Attributes:
        laws: rows that hide a law.
        exact: of them, with exactly that law as the best guess.
        listed: of the others, ambiguous ones that list it.
        others: rows that hide no law: nothing, or a sensor's fault or a far start.
        told: of them, those of which just that is said.
        wrong_unflagged: rows with a wrong verdict that is told as if it were certain.
        failed: rows without a verdict.
    """

    laws: int
    exact: int
    listed: int
    others: int
    told: int
    wrong_unflagged: int
    failed: int


def count_claims(rows: Sequence[ComparedRow]) -> Claims:
    """Return what the analysis claimed of rows, and how much of it holds."""
    laws = [row for row in rows if row.record["law"]]
    others = [row for row in rows if not row.record["law"]]
    open_ = [row for row in laws if not is_right(row.record)]
    return Claims(
        laws=len(laws),
        exact=len(laws) - len(open_),
        listed=sum(bool(row.listed) for row in open_),
        others=len(others),
        told=sum(is_right(row.record) for row in others),
        wrong_unflagged=sum(wrong_unflagged(row.record) for row in rows),
        failed=sum(row.record["problem"] is not None for row in rows),
    )


def is_right(record: Record) -> bool:
    """Return whether the law is the hidden one; where none is hidden, whether the cause is told."""
    if record["problem"] is not None:
        return False
    if record["law"]:
        return record["exact_support"] is True
    if record["null"]:
        return bool(record["verdict"] == "nothing-missing")
    return record.get("cause_right") is True


def wrong_unflagged(record: Record) -> bool:
    """Return whether a wrong verdict was told as if it were certain."""
    return record["problem"] is None and not is_right(record) and not record["flagged"]
