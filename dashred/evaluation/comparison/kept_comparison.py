"""What a comparison keeps of one recording: ``compared.json`` beside the findings."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TypedDict

from dashred.core.findings.findings import sha256_of, write_json_atomic

COMPARED = "compared.json"
# Why there is nothing to compare, or not all.
UNRESOLVED = "the simulator is not resolved, so that the analysis has no field to compare"
OTHERS_FAILED = "the other methods failed as a whole"


class Compared(TypedDict):
    """How right one method is.

    ``rmse``: of the field over the fit window, in standard deviations. ``exact``: whether its law
    has all true terms and no others. ``found``, ``spurious`` and ``missed``: terms; of a method
    that looked for a law and names none, all are missed. ``coefficient_error``: the worst of those
    found, relative. ``failed``: what it died of. Null is what the method does not tell.
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
    """``compared.json``: how right every method is on one recording.

    ``problem``: why nothing could be compared, or the other methods not. ``listed``: of ambiguous
    findings, whether the true law is among the three listed. ``git_commit``: of the scorer.
    """

    findings_sha256: str
    problem: str | None
    listed: bool | None
    git_commit: str
    methods: dict[str, Compared]


def write_uncompared(folder: Path, problem: str) -> Comparison:
    """Keep why a row's methods could not be held against its truth."""
    comparison = Comparison(
        findings_sha256=sha256_of(folder / "findings.json"),
        problem=problem,
        listed=None,
        git_commit="",
        methods={},
    )
    write_json_atomic(folder / COMPARED, comparison)
    return comparison


def read_compared(folder: Path) -> Comparison | None:
    """Return what was made of these findings; None where nothing was, or of earlier ones."""
    try:
        record: Comparison = json.loads((folder / COMPARED).read_text(encoding="utf-8"))
        same = record["findings_sha256"] == sha256_of(folder / "findings.json")
    except (OSError, ValueError, TypeError, KeyError):
        return None
    return record if same and record.keys() == Comparison.__annotations__.keys() else None
