"""Write and read ``compared.json``, the comparison of all methods on one recording."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TypedDict

from dashred.core.findings.findings import sha256_of, write_json_atomic

COMPARED = "compared.json"
# Reasons why methods could not be compared.
UNRESOLVED = "the simulator is not resolved, so that the analysis has no field to compare"
OTHERS_FAILED = "the other methods failed as a whole"


class MethodScore(TypedDict):
    """Scores of one method.

    ``rmse``: error of the field over the fit window, in standard deviations. ``exact``: whether the
    law has exactly the true terms. ``found``, ``spurious`` and ``missed``: numbers of terms; if a
    law was sought and none was found, all are missed. ``coefficient_error``: largest relative error
    of the terms found. ``failed``: cause of a failure. Null if the method does not provide a value.
    """

    rmse: float | None
    exact: bool | None
    found: int | None
    spurious: int | None
    missed: int | None
    coefficient_error: float | None
    seconds: float | None
    note: str
    failed: str | None


class Comparison(TypedDict):
    """``compared.json``: scores of all methods on one recording.

    ``problem``: why some methods could not be compared. ``listed``: whether ambiguous findings list
    the true law among the first three. ``git_commit``: commit of the scorer.
    """

    findings_sha256: str
    problem: str | None
    listed: bool | None
    git_commit: str
    methods: dict[str, MethodScore]


def write_failed_comparison(folder: Path, problem: str) -> Comparison:
    """Store why the methods of a row could not be compared with its truth."""
    comparison = Comparison(
        findings_sha256=sha256_of(folder / "findings.json"),
        problem=problem,
        listed=None,
        git_commit="",
        methods={},
    )
    write_json_atomic(folder / COMPARED, comparison)
    return comparison


def read_comparison(folder: Path) -> Comparison | None:
    """Return the stored comparison of these findings; None if there is none."""
    try:
        record: Comparison = json.loads((folder / COMPARED).read_text(encoding="utf-8"))
        same = record["findings_sha256"] == sha256_of(folder / "findings.json")
    except (OSError, ValueError, TypeError, KeyError):
        return None
    return record if same and record.keys() == Comparison.__annotations__.keys() else None
