"""A law with nearly as many coefficients as readings is not proved by them."""

from __future__ import annotations

import pytest

from dashred.core.findings.cause_schema import Verdict
from dashred.pipeline.verification.few_readings import FEWEST_READINGS, are_too_few
from dashred.reporting.text.support import contradictions, is_scant
from dashred.reporting.text.verdict import meaning


@pytest.mark.parametrize("verdict", ["missing-term", "parameter"])
def test_a_law_needs_several_readings_for_each_coefficient(verdict: Verdict) -> None:
    enough = 4 * FEWEST_READINGS + 2
    assert not are_too_few(verdict, 4, enough, 2)
    assert are_too_few(verdict, 4, enough - 1, 2)


@pytest.mark.parametrize("verdict", ["nothing-missing", "sensor-fault", "ambiguous"])
def test_another_verdict_states_no_firm_law(verdict: Verdict) -> None:
    assert not are_too_few(verdict, 4, 8, 2)


def test_the_report_says_that_the_readings_are_too_few() -> None:
    fit = {
        "comparisons": [{"worse": False}],
        "readings": 22,
        "start_values": 2,
        "unconfirmed": "few-readings",
    }
    findings = {"verdict": "unconfirmed", "terms": [{}] * 4, "fit": fit}
    assert is_scant(findings)
    assert "too few to prove it" in meaning(findings)
    [why] = contradictions(findings)
    assert "4 coefficients and 2 start values were fitted to 22 readings" in why
    one = findings | {"terms": [{}], "fit": fit | {"start_values": 0}}
    assert contradictions(one)[0].startswith("1 coefficient was fitted to 22 readings. ")
    worse = {"comparisons": [{"worse": True}], "unconfirmed": "worse"}
    contradicted = findings | {"fit": fit | worse}
    assert not is_scant(contradicted)
    assert "contradict" in meaning(contradicted)
