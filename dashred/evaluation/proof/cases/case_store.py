"""Write and read ``case.json``, the result of a finished case."""

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
class StoredCase:
    """The stored result of a finished case.

    Attributes:
        record: record of the case.
        wall: wall-clock seconds.
        draws: number of draws.
        scored_by: commit that rescored the case; None if it has not been rescored.
    """

    record: CaseRecord
    wall: float
    draws: int
    scored_by: str | None = None


def folder_of(case: Case, output: Path) -> Path:
    """Return the folder of a case."""
    return output / str(case).replace(" ", "-")


def store_case(case: Case, output: Path, stored: StoredCase) -> None:
    """Write the result of a case atomically."""
    document = {
        "case_sha256": hash_of(case),
        "draws": stored.draws,
        "record": stored.record,
        "scored_by": stored.scored_by,
        "wall_seconds": stored.wall,
    }
    write_json_atomic(folder_of(case, output) / DOCUMENT, document)


def read_case(case: Case, output: Path) -> StoredCase | None:
    """Return the stored result of a case; None if there is none of the same case."""
    try:
        text = (folder_of(case, output) / DOCUMENT).read_text(encoding="utf-8")
        known: dict[str, Any] = json.loads(text)
        same = known["case_sha256"] == hash_of(case)
        wall, draws = float(known["wall_seconds"]), int(known["draws"])
        return StoredCase(known["record"], wall, draws, known.get("scored_by")) if same else None
    except (OSError, ValueError, TypeError, KeyError):
        return None


def read_finished(case: Case, output: Path) -> StoredCase | None:
    """Return the stored result of a successful case; None if it must be run."""
    stored = read_case(case, output)
    return stored if stored is not None and stored.record["problem"] is None else None


def hash_of(case: Case) -> str:
    """Return the hash of a case, which identifies its draw.

    Sizes are drawn by functions whose last digit depends on the processor, and an interrupted draw
    may go on on another machine. Twelve digits are the same everywhere.
    """
    text = json.dumps(_rounded(asdict(case)), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _rounded(value: Any) -> Any:
    """Return a document whose numbers have twelve digits."""
    match value:
        case float():
            return float(f"{value:.12g}")
        case dict():
            return {key: _rounded(part) for key, part in value.items()}
        case list() | tuple():
            return [_rounded(part) for part in value]
    return value
