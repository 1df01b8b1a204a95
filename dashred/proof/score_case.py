"""Open and score one case whose findings are frozen: when it was analysed, or again."""

from __future__ import annotations

from pathlib import Path

from dashred.findings import check_freeze, write_json_atomic
from dashred.proof.case_record import CaseRecord
from dashred.proof.judge import judge
from dashred.proof.record_case import RecordedCase
from dashred.score import score_findings

SEAL = "sealed.nc"


def score_case(recorded: RecordedCase, folder: Path, seconds: float | None) -> CaseRecord:
    """Return the record of a case; leaves ``score.json`` and the figures that show the truth.

    Args:
        recorded: what was drawn, and the truth.
        folder: of the frozen findings, and of the sealed truth beside them.
        seconds: that the analysis took.

    Raises:
        InputError: the findings are not those that were frozen.
    """
    check_freeze(folder)
    score, *_ = score_findings(folder, folder / SEAL)
    write_json_atomic(folder / "score.json", score)
    return judge(recorded.case, recorded.concealed, folder, score, seconds)
