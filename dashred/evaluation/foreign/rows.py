"""The row of a case: its schema, and its file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import NotRequired, TypedDict

from dashred.core.findings.findings import write_json_atomic
from dashred.evaluation.foreign.cases.case import Case, Collection, Kind
from dashred.evaluation.foreign.scoring.outcomes import Outcome

ROWS = "rows"


class PeerRow(TypedDict):
    """The answer of another method.

    Attributes:
        right: whether its law is exact; null if it gave none.
        told: its law as text.
        seconds: wall-clock seconds of its process.
        problem: why it gave none.
        versions: of the packages that it runs on; rows of early draws have none.
    """

    right: bool | None
    told: str
    seconds: float
    problem: str | None
    versions: NotRequired[dict[str, str]]


class Row(TypedDict):
    """The result of a case.

    Attributes:
        case: name of the case.
        collection: of its system.
        system: name of the system in the collection.
        kind: what is hidden.
        number: number of the draw of the system.
        noise: std of the noise as a share of that of a reading.
        seed: seed of the draw.
        hidden: what was hidden, as text.
        verdict: of the findings.
        told: what the findings say, as text.
        outcome: right, listed, flagged, silent-wrong or no-answer.
        leading_right: whether the leading cause is the true one.
        probability: of the leading cause.
        located: whether the peak of a source is inside of it.
        covered: whether a 95 % interval has the true value, for each told term of the true law.
        gain_sensors: error of the fitted start over that of the corrected simulation at the test
            sensors.
        gain_time: the same in the held-out time, of runs from the start of the recording.
        gain_forecast: the same of runs from a state that is fitted just before the held-out time.
        seconds: CPU seconds of the analysis; of an analysis that was ended, its limit.
        wall: wall-clock seconds of the analysis.
        problem: why there is no answer.
        peers: by method.
    """

    case: str
    collection: Collection
    system: str
    kind: Kind
    number: int
    noise: float
    seed: int
    hidden: str
    verdict: str | None
    told: str
    outcome: Outcome
    leading_right: bool
    probability: float | None
    located: bool | None
    covered: list[bool]
    gain_sensors: float | None
    gain_time: float | None
    gain_forecast: NotRequired[float | None]
    seconds: float | None
    wall: float
    problem: str | None
    peers: dict[str, PeerRow]


def row_path(output: Path, case: Case) -> Path:
    """Return the file of a row."""
    return output / ROWS / f"{case.name}.json"


def write_row(output: Path, case: Case, row: Row) -> None:
    """Write a row completely or not at all."""
    write_json_atomic(row_path(output, case), row)


def read_row(output: Path, case: Case) -> Row | None:
    """Return the row of a case; None if there is none of this draw."""
    try:
        row: Row = json.loads(row_path(output, case).read_text(encoding="utf-8"))
        same = (row["case"], row["seed"], row["kind"]) == (case.name, case.seed, case.kind)
    except (OSError, ValueError, TypeError, KeyError):
        return None
    return row if same else None


def is_done(output: Path, case: Case) -> bool:
    """Return whether the analysis of a case has ended, in whatever way.

    A case whose truth or score could not be computed is run again.
    """
    row = read_row(output, case)
    return row is not None and row["seconds"] is not None


def read_rows(output: Path) -> list[Row]:
    """Return all rows of a folder, by name."""
    paths = sorted((output / ROWS).glob("*.json"))
    return [json.loads(path.read_text(encoding="utf-8")) for path in paths]
