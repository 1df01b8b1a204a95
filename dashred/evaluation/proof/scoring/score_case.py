"""Open the seal of a case with frozen findings and score it."""

from __future__ import annotations

from pathlib import Path

from dashred.core.findings.findings import write_json_atomic
from dashred.evaluation.proof.cases.case_record import CaseRecord
from dashred.evaluation.proof.cases.record_case import RecordedCase
from dashred.evaluation.proof.scoring.judge import judge
from dashred.evaluation.twins.score_command import score_findings
from dashred.evaluation.twins.seal_store import SEALED


def score_case(recorded: RecordedCase, folder: Path, seconds: float | None) -> CaseRecord:
    """Return the record of a case; write ``score.json`` and the figures with the truth.

    Args:
        recorded: the case and its truth.
        folder: folder of the findings, already verified, and of the sealed truth.
        seconds: CPU seconds of the analysis.
    """
    score, *_ = score_findings(folder, folder / SEALED)
    write_json_atomic(folder / "score.json", score)
    return judge(recorded.case, recorded.case_truth, folder, score, seconds)
