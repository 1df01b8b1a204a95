"""Open and score one case whose findings are frozen: when it was analysed, or again."""

from __future__ import annotations

from pathlib import Path

from dashred.core.findings.findings import write_json_atomic
from dashred.evaluation.proof.cases.case_record import CaseRecord
from dashred.evaluation.proof.cases.record_case import RecordedCase
from dashred.evaluation.proof.scoring.judge import judge
from dashred.evaluation.twins.kept_seal import SEALED
from dashred.evaluation.twins.score_command import score_findings


def score_case(recorded: RecordedCase, folder: Path, seconds: float | None) -> CaseRecord:
    """Return the record of a case; leaves ``score.json`` and the figures that show the truth.

    Args:
        recorded: what was drawn, and the truth.
        folder: of the findings, found to be those that were frozen, and of the sealed truth.
        seconds: that the analysis took.
    """
    score, *_ = score_findings(folder, folder / SEALED)
    write_json_atomic(folder / "score.json", score)
    return judge(recorded.case, recorded.concealed, folder, score, seconds)
