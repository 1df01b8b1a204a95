"""The true terms without their coefficients, for the method that is told them."""

from __future__ import annotations

import json
from pathlib import Path

from dashred.core.findings.findings import write_json_atomic
from dashred.evaluation.foreign.cases.case import Truth
from dashred.physics.expressions import algebra
from dashred.physics.system import System, Term

FORM = "form.json"


def write_true_form(folder: Path, truth: Truth) -> None:
    """Write the true terms of a case, beside its configuration."""
    terms = [[term.equation, term.term] for term in truth.terms]
    write_json_atomic(folder / FORM, {"terms": terms})


def read_true_form(folder: Path, system: System) -> list[Term]:
    """Read the true terms; each has one coefficient."""
    stored = json.loads((folder / FORM).read_text(encoding="utf-8"))["terms"]
    return [
        Term(equation, algebra.split_coefficient(system.parse(text, FORM, equation=equation))[1])
        for equation, text in stored
    ]
