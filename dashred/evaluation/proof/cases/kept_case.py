"""What a finished case leaves in its folder, and how it is read again: ``case.json``."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from dashred.core.findings.findings import write_json_atomic
from dashred.evaluation.proof.cases.case_record import CaseRecord
from dashred.evaluation.proof.cases.draw import Case

DOCUMENT, RECORDING = "case.json", "recording.nc"


@dataclass(frozen=True)
class Kept:
    """What a finished case leaves.

    Attributes:
        record: how it ended.
        wall: seconds by the clock.
        draws: how often it was drawn.
        scored_by: commit that scored it again; None of one that was scored when it was analysed.
    """

    record: CaseRecord
    wall: float
    draws: int
    scored_by: str | None = None


def folder_of(case: Case, output: Path) -> Path:
    """Return the folder of a case."""
    return output / str(case).replace(" ", "-")


def keep(case: Case, output: Path, kept: Kept) -> None:
    """Write what a case leaves, at once or not at all."""
    document = {
        "case_sha256": hash_of(case),
        "draws": kept.draws,
        "record": kept.record,
        "scored_by": kept.scored_by,
        "wall_seconds": kept.wall,
    }
    write_json_atomic(folder_of(case, output) / DOCUMENT, document)


def read_kept(case: Case, output: Path) -> Kept | None:
    """Return what a case left; None where there is nothing of this very case."""
    try:
        text = (folder_of(case, output) / DOCUMENT).read_text(encoding="utf-8")
        known: dict[str, Any] = json.loads(text)
        same = known["case_sha256"] == hash_of(case)
        wall, draws = float(known["wall_seconds"]), int(known["draws"])
        return Kept(known["record"], wall, draws, known.get("scored_by")) if same else None
    except (OSError, ValueError, TypeError, KeyError):
        return None


def read_done(case: Case, output: Path) -> Kept | None:
    """Return what a case left that is done; one that died is tried again."""
    kept = read_kept(case, output)
    return kept if kept is not None and kept.record["problem"] is None else None


def hash_of(case: Case) -> str:
    """Return the hash of all that was drawn first: no record tells from what seed."""
    text = json.dumps(asdict(case), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()
