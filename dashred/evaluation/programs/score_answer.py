"""Score the findings of a row."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dashred.core.findings.findings import check_freeze
from dashred.evaluation.programs.rows import Answer
from dashred.evaluation.twins.findings_reader import read_findings
from dashred.evaluation.twins.scoring import law_of_findings, law_of_truth, score_law
from dashred.evaluation.twins.sealing import Truth


def score_answer(folder: Path, truth: Truth, seconds: float) -> Answer:
    """Return the answer of frozen findings.

    Raises:
        InputError: the findings have changed since they were frozen.
    """
    check_freeze(folder)
    findings = read_findings(folder)
    exact, error = score_law(findings, truth.terms, truth.concealed.parameters)
    return Answer(
        verdict=findings["verdict"],
        exact=exact,
        error=error,
        deviation=largest_deviation(findings, truth) if exact else None,
        seconds=seconds,
        problem=None,
    )


def largest_deviation(findings: Mapping[str, Any], truth: Truth) -> float | None:
    """Return the largest error of a coefficient in units of its stated std; None without a std.

    Args:
        findings: with an exact law.
        truth: what was hidden.
    """
    true = law_of_truth(findings, truth.terms, truth.concealed.parameters)
    deviations = []
    for entry in findings["terms"]:
        [(key, found)] = law_of_findings({**findings, "terms": [entry]}).items()
        if entry["std"] and entry["coefficient"]:
            # The term may contain a number; its std is that of the coefficient before it.
            scale = abs(found / entry["coefficient"])
            deviations.append(abs(found - true[key]) / (scale * entry["std"]))
    return max(deviations, default=None)
