"""What a stranger reads in the list of runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dashred.core.findings.fit_schema import errors_by_method
from dashred.core.findings.schema import new_findings
from dashred.pipeline.run.run_tags import headline_metrics, note, short_verdict


def findings(**known: Any) -> dict[str, Any]:
    source: Any = {"config": {"system": {}}, "seed": 0, "splits": None}
    return dict(new_findings(source, **known))


def law(*terms: str) -> list[dict[str, Any]]:
    return [{"equation": "u", "term": term, "coefficient": -0.5, "says": term} for term in terms]


def test_a_run_is_named_by_its_verdict_and_the_first_of_its_terms() -> None:
    found = findings(verdict="missing-term", terms=law("u", "u**3"))
    assert short_verdict(found) == "missing-term: u, u**3"
    found = findings(verdict="missing-term", terms=law("u", "u**2", "u**3", "u**4"))
    assert short_verdict(found) == "missing-term: u, u**2, u**3, …"
    assert short_verdict(findings(verdict="nothing-missing", terms=[])) == "nothing-missing"


def test_the_headline_has_coefficients_errors_and_gains() -> None:
    found = findings(terms=law("u**3"))
    found["fit"]["test_sensors"] = errors_by_method(simulation_refit=0.6, corrected=0.2)
    numbers = headline_metrics(found)
    assert numbers["coef/u/u.pow3"] == -0.5
    assert numbers["test_sensors/corrected"] == 0.2
    assert round(numbers["gain/test_sensors"], 12) == 3
    assert not any(name.startswith("heldout_time") for name in numbers)


def test_a_parameter_is_a_coefficient_of_no_equation() -> None:
    change = {"equation": None, "parameter": "nu", "term": "nu", "coefficient": 0.01}
    assert headline_metrics(findings(terms=[change]))["coef/parameter/nu"] == 0.01


def test_findings_without_a_fit_have_no_numbers() -> None:
    assert headline_metrics(findings(verdict="unresolved-numerics")) == {}


def test_a_note_is_markdown_in_which_formulas_stay_as_they_are() -> None:
    cause = {"kind": "x", "says": "it leaves out −0.5·u*v_x", "probability": 1.0}
    found = findings(verdict="missing-term", causes=[cause])
    text = note(found, Path("/runs/one"))
    assert text.startswith("**Verdict: missing-term: ")
    assert "- It leaves out −0.5·u\\*v\\_x." in text
    assert "`report.html`" in text and "`/runs/one`" in text
